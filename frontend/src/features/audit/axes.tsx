import type { AxisAudit } from "../../api/client";
import { axisNames, unitOf } from "../../ui/axes";
import { plusMinus, stdText, withSigma } from "../../ui/format";
import { LevelIcon, type Tone } from "../../ui/icons";
import css from "./audit.module.css";

type Word = { tone: Tone; text: string };

/** What is said of one axis. */
export function wordOf({ verdict, difference }: Pick<AxisAudit, "verdict" | "difference">): Word {
  switch (verdict) {
    case "passed":
      return { tone: "good", text: "pass" };
    case "failed":
      return { tone: "error", text: "fail" };
    case "unknown":
      return { tone: "warning", text: "cannot tell" };
    case null:
      return { tone: "info", text: difference === null ? "not given" : "not judged" };
  }
}

/** Each axis against its limit, with what this recording could have shown at all. */
export function AxisTable({ axes }: { axes: readonly AxisAudit[] }) {
  return (
    <div className={css.scroll} tabIndex={0} role="region" aria-label="Axis by axis">
      <table className={css.axes}>
        <caption className="sr-only">Given minus found on each axis, with one standard deviation and the limit</caption>
        <thead>
          <tr>
            <th scope="col">Given minus found</th>
            <th scope="col">Difference</th>
            <th scope="col">1 σ</th>
            <th scope="col" aria-hidden="true" />
            <th scope="col">Allowed</th>
            <th scope="col">Shows from</th>
            <th scope="col">Verdict</th>
          </tr>
        </thead>
        <tbody>
          {axes.map((axis) => {
            const unit = unitOf(axis.axis);
            const text = withSigma(axis.difference ?? 0, axis.difference_std, unit);
            const { tone, text: word } = wordOf(axis);
            return (
              <tr key={axis.axis} data-tone={tone}>
                <th scope="row">{axisNames[axis.axis]}</th>
                <td className="num" data-label="Difference">
                  {axis.difference === null ? "–" : `${text.value} ${text.unit}`}
                </td>
                <td className="num dim">
                  {plusMinus(text)}
                  {text.unit !== unit && ` ${text.unit}`}
                </td>
                <td className={css.drawn}>
                  <Gauge axis={axis} />
                </td>
                <td className="num" data-label="Allowed">
                  {axis.limit === null ? "–" : `${Number(axis.limit.toPrecision(3))} ${unit}`}
                </td>
                <td className="num dim" data-label="Shows from">
                  {shownFrom(axis)}
                </td>
                <td>
                  <span className={css.word}>
                    <LevelIcon level={tone} size={15} />
                    {word}
                  </span>
                </td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </div>
  );
}

/** What would have shown: the limit as it was given, or three standard deviations. */
function shownFrom({ axis, limit, smallest_error: least }: AxisAudit): string {
  if (limit !== null && least <= limit) return `${Number(limit.toPrecision(3))} ${unitOf(axis)}`;
  const [std, unit] = axis.startsWith("r")
    ? ([least, "deg"] as const)
    : ([least / 1000, axis === "dt" ? "s" : "m"] as const);
  return stdText(std, unit);
}

const width = 120;
const height = 16;
/** How many of what is allowed the drawing reaches to either side. */
const reach = 1.6;

/** The difference with three standard deviations, in the band that is allowed. */
function Gauge({ axis }: { axis: AxisAudit }) {
  const allowed = axis.limit ?? axis.smallest_error;
  const x = (value: number) =>
    width / 2 + (Math.max(-reach, Math.min(reach, value / allowed)) / reach) * (width / 2 - 4);
  const { difference, difference_std: std } = axis;
  return (
    <svg className={css.gauge} width={width} height={height} viewBox={`0 0 ${width} ${height}`} aria-hidden="true">
      <line x1={0} x2={width} y1={height / 2} y2={height / 2} className={css.track} />
      {axis.limit !== null && (
        <rect x={x(-allowed)} width={x(allowed) - x(-allowed)} y={2} height={height - 4} className={css.band} />
      )}
      <line x1={width / 2} x2={width / 2} y1={1} y2={height - 1} className={css.zero} />
      {difference !== null && (
        <>
          <line
            x1={x(difference - 3 * std)}
            x2={x(difference + 3 * std)}
            y1={height / 2}
            y2={height / 2}
            className={css.whisker}
          />
          <circle cx={x(difference)} cy={height / 2} r={3.5} className={css.dot} />
        </>
      )}
    </svg>
  );
}
