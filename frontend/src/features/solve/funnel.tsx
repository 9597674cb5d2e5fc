import { Fragment } from "react";
import { fixed, heldText, plusMinus, withSigma } from "../../ui/format";
import type { Parameter } from "./parameters";
import css from "./solve.module.css";

const width = 92;
const height = 26;
const shown = 24;

/** The last iterations of one parameter: its value as a line inside a band of one standard deviation. */
export function Funnel({ parameter }: { parameter: Parameter }) {
  const values = parameter.values.slice(-shown);
  const sigmas = parameter.sigmas.slice(-shown);
  const final = values.at(-1) ?? 0;
  const reach = Math.max(1e-9, ...values.map((value, i) => Math.abs(value - final) + Math.min(sigmas[i] ?? 0, 1e6)));
  // A square root keeps the last, small steps visible beside the first, large ones.
  const y = (offset: number) =>
    height / 2 - (Math.sign(offset) * Math.sqrt(Math.abs(offset) / reach) * (height - 4)) / 2;
  const x = (i: number) => (values.length < 2 ? width : (i * width) / (values.length - 1));
  const line = values.map((value, i) => `${x(i).toFixed(1)},${y(value - final).toFixed(1)}`);
  const upper = values.map((value, i) => `${x(i).toFixed(1)},${y(value - final + (sigmas[i] ?? 0)).toFixed(1)}`);
  const lower = values
    .map((value, i) => `${x(i).toFixed(1)},${y(value - final - (sigmas[i] ?? 0)).toFixed(1)}`)
    .reverse();
  return (
    <svg
      className={css.funnel}
      width={width}
      height={height}
      viewBox={`0 0 ${width} ${height}`}
      aria-hidden="true"
      data-axis={parameter.axis}
    >
      {values.length > 1 && (
        <>
          <polygon points={[...upper, ...lower].join(" ")} />
          <polyline points={line.join(" ")} />
        </>
      )}
    </svg>
  );
}

interface ParameterTableProps {
  parameters: readonly Parameter[];
  /** Roll, pitch and yaw; null before the first round. */
  angles: readonly string[] | null;
}

export function ParameterTable({ parameters, angles }: ParameterTableProps) {
  return (
    <table className={css.parameters}>
      <caption className="sr-only">The answer so far, with one standard deviation</caption>
      <tbody>
        {parameters.map((parameter) => (
          <Fragment key={parameter.key}>
            {parameter.key === "rx" && (
              <tr>
                <th scope="row">Roll, pitch, yaw</th>
                <td className={`num ${css.angles ?? ""}`} colSpan={3}>
                  {angles?.join("  ") ?? "–"}
                </td>
                <td className={css.unit}>°</td>
              </tr>
            )}
            <ParameterRow parameter={parameter} />
          </Fragment>
        ))}
      </tbody>
    </table>
  );
}

function ParameterRow({ parameter }: { parameter: Parameter }) {
  const value = parameter.values.at(-1);
  const sigma = parameter.sigmas.at(-1);
  const text =
    value === undefined || sigma === undefined
      ? null
      : sigma === null
        ? heldText(value, parameter.unit)
        : withSigma(value, sigma, parameter.unit);
  return (
    <tr>
      <th scope="row" data-axis={parameter.axis}>
        {parameter.name}
      </th>
      <td>
        <Funnel parameter={parameter} />
      </td>
      <td className="num">{parameter.unit === "°" ? "" : (text?.value ?? "–")}</td>
      <td className={`num ${css.sigma ?? ""}`}>{text === null ? "" : plusMinus(text)}</td>
      <td className={css.unit}>{text?.unit ?? parameter.unit}</td>
    </tr>
  );
}

interface ResidualBarsProps {
  rows: readonly { name: string; rms_m: number }[];
  looks: ReadonlyMap<string, { title: string; color: string }>;
}

/** Root mean square distance of each plane's points, in millimetres. */
export function ResidualBars({ rows, looks }: ResidualBarsProps) {
  const most = Math.max(1e-6, ...rows.map((row) => row.rms_m));
  return (
    <ul className={css.residuals}>
      {rows.map((row) => (
        <li key={row.name}>
          <span className="clip">{looks.get(row.name)?.title ?? row.name}</span>
          <span className={css.track}>
            <span
              style={{
                width: `${(100 * row.rms_m) / most}%`,
                background: looks.get(row.name)?.color ?? "var(--ink-3)",
              }}
            />
          </span>
          <span className="num">{fixed(row.rms_m * 1000, 1)}</span>
        </li>
      ))}
    </ul>
  );
}
