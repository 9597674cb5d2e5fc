import type { DoctorReport } from "../../api/client";
import { fixed, NARROW } from "../../ui/format";
import { LevelIcon } from "../../ui/icons";
import css from "./recording.module.css";

type ForecastReport = NonNullable<DoctorReport["forecast"]>;
type Parameter = ForecastReport["parameters"][number];

const names: Record<Parameter["name"], string> = {
  rx: "Turn x",
  ry: "Turn y",
  rz: "Turn z",
  tx: "Position x",
  ty: "Position y",
  tz: "Position z",
  dt: "Time offset",
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

interface ForecastProps {
  forecast: ForecastReport;
  planes: DoctorReport["planes"];
  /** Sentences that stand above already. */
  said: readonly string[];
}

/** What a solve would know, before it is run, and the planes that rests on. */
export function Forecast({ forecast, planes, said }: ForecastProps) {
  const headline = forecast.parameters.length === 0 ? forecast.reason : forecast.text;
  return (
    <section aria-label="Forecast" className={css.forecastCard} data-weak={forecast.parameters.length === 0 || forecast.weak.length > 0}>
      <h2>What a solve would know</h2>
      {headline !== "" && !said.includes(headline) && <p>{headline}</p>}
      {planes !== null && planes !== undefined && planes.text !== "" && <p className="dim">{planes.text}</p>}
      {forecast.parameters.length > 0 && (
        <ul className={css.forecast}>
          {forecast.parameters.map((parameter) => (
            <li key={parameter.name} data-weak={parameter.weak}>
              <span className="dim small">{names[parameter.name]}</span>
              <span className="num">
                ±{NARROW}
                {shown(parameter)} {parameter.weak && <LevelIcon level="warning" size={13} />}
              </span>
            </li>
          ))}
        </ul>
      )}
      {forecast.weak.length > 0 && (
        <ul className={css.bullets}>
          {forecast.weak.map((sentence) => (
            <li key={sentence}>{sentence}</li>
          ))}
        </ul>
      )}
      {forecast.parameters.length > 0 && (
        <p className="dim small">
          One standard deviation each
          {forecast.covered_s > 0 && `, from ${fixed(forecast.covered_s, 0)} s of motion that could be followed`}.
        </p>
      )}
    </section>
  );
}
