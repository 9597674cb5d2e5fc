import type { DoctorReport } from "../../api/client";
import { fixed } from "../../ui/format";
import { LevelIcon } from "../../ui/icons";
import css from "./recording.module.css";

type ForecastReport = NonNullable<DoctorReport["forecast"]>;
type Parameter = ForecastReport["parameters"][number];

const names: Record<Parameter["name"], string> = {
  rx: "Turn x",
  ry: "Turn y",
  rz: "Turn z",
  tx: "Lever x",
  ty: "Lever y",
  tz: "Lever z",
  dt: "Clock",
};

function shown({ std, unit }: Parameter): string {
  switch (unit) {
    case "deg":
      return `${precise(std)}°`;
    case "m":
      return `${precise(std * 1000)} mm`;
    case "s":
      return `${precise(std * 1000)} ms`;
  }
}

function precise(value: number): string {
  return value >= 1000 ? "> 1000" : fixed(value, Math.max(0, 1 - Math.floor(Math.log10(Math.max(value, 1e-9)))));
}

/** What a solve would know, before it is run. */
export function Forecast({ parameters }: { parameters: readonly Parameter[] }) {
  return (
    <section aria-label="Forecast">
      <h2 className={css.heading}>What a solve of it would know, one standard deviation</h2>
      <ul className={css.forecast}>
        {parameters.map((parameter) => (
          <li key={parameter.name} data-weak={parameter.weak}>
            <span className="dim small">{names[parameter.name]}</span>
            <span className="num">
              {shown(parameter)} {parameter.weak && <LevelIcon level="warning" size={13} />}
            </span>
          </li>
        ))}
      </ul>
    </section>
  );
}
