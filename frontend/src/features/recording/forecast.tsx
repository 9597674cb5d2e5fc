import { useQuery } from "@tanstack/react-query";
import type { DoctorReport, Planes } from "../../api/client";
import { factsQuery } from "../../api/queries";
import { fixed, foreseenText } from "../../ui/format";
import { planesOf, sentenceCase } from "../../ui/words";
import { LevelIcon } from "../../ui/icons";
import css from "./recording.module.css";

type ForecastReport = NonNullable<DoctorReport["forecast"]>;

interface ForecastProps {
  forecast: ForecastReport;
  /** On the planes that it rests on; empty where nothing is to be said. */
  planes: string;
  /** Sentences that stand above already. */
  said: readonly string[];
}

function same(one: string, other: string): boolean {
  return bare(one) === bare(other);
}

function bare(text: string): string {
  return text.toLowerCase().replace(/\.$/, "");
}

function sentenceOf(text: string): string {
  return `${sentenceCase(text).replace(/\.$/, "")}.`;
}

/** On what planes the forecast rests: once they have been found, it is told which are chosen. */
export function planesText(report: DoctorReport["planes"], found: Planes | undefined): string {
  if (found === undefined) return report?.text ?? "";
  const chosen = found.patches.filter((patch) => patch.confirmed).length;
  const all = found.patches.length;
  // Here nobody has confirmed any yet: what is chosen may be the suggestion.
  if (chosen === all)
    return found.determinacy.ok
      ? `${planesOf(all)} seen; together they fix where the lidar is.`
      : found.determinacy.text;
  const which = all === 1 ? "the one plane that was" : `all ${all} planes that were`;
  return `With ${which} found; ${chosen === 1 ? "1 is" : `${chosen} are`} chosen now.`;
}

/** What a solve would know, before it is run, and the planes that rests on. */
export function Forecast({ forecast, planes, said }: ForecastProps) {
  const names = useQuery(factsQuery).data?.axis_names ?? {};
  const weak = forecast.weak.filter((sentence) => !said.some((other) => same(other, sentence)));
  const nothing = forecast.parameters.length === 0;
  const headline = nothing ? forecast.reason : forecast.text;
  const repeated = headline === "" || said.some((sentence) => same(sentence, headline));
  return (
    <section aria-label="Forecast" className={css.forecastCard} data-weak={nothing || forecast.weak.length > 0}>
      <h2>What a solve would know</h2>
      {nothing && repeated ? <p>No forecast, for the reason above.</p> : !repeated && <p>{sentenceOf(headline)}</p>}
      {!nothing && planes !== "" && !said.some((sentence) => same(sentence, planes)) && <p className="dim">{planes}</p>}
      {forecast.parameters.length > 0 && (
        <ul className={css.forecast}>
          {forecast.parameters.map((parameter) => (
            <li key={parameter.name} data-weak={parameter.weak}>
              <span className="dim small">{names[parameter.name] ?? parameter.name}</span>
              <span className="num">
                {foreseenText(parameter.std, parameter.unit, parameter.weak)}{" "}
                {parameter.weak && <LevelIcon level="warning" size={13} />}
              </span>
            </li>
          ))}
        </ul>
      )}
      {weak.length > 0 && (
        <ul className={css.bullets}>
          {weak.map((sentence) => (
            <li key={sentence}>{sentence}</li>
          ))}
        </ul>
      )}
      {forecast.parameters.length > 0 && (
        <p className="dim small">
          One standard deviation each
          {forecast.covered_s > 0 && `, from ${fixed(forecast.covered_s, 0)} s that could be followed`}.
        </p>
      )}
    </section>
  );
}
