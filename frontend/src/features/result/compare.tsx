import { NativeSelect, Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import type { Run } from "../../api/client";
import { resultQuery } from "../../api/queries";
import { fixed, withSigma } from "../../ui/format";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import { differences } from "./difference";
import css from "./result.module.css";

/** An answer this many sigmas from another is not the same answer. */
const apart = 3;

function answered(run: Run): boolean {
  return run.job.result?.kind === "solve" && run.job.result.translation_m !== null;
}

function title(run: Run, runs: readonly Run[]): string {
  const number = runs.length - runs.indexOf(run);
  const when = new Date(run.job.created_at).toLocaleString(undefined, { dateStyle: "short", timeStyle: "short" });
  return `Run ${number}, ${run.job.settings.method === "paper" ? "as published" : "full"}, ${when}`;
}

/** Any two answers of this recording side by side: what differs, and whether by more than both are unsure of. */
export function Compare({ runs, shown }: { runs: readonly Run[]; shown: string }) {
  const known = runs.filter(answered);
  const [firstId, setFirst] = useState(known.find((run) => run.job.id !== shown)?.job.id ?? "");
  const [secondId, setSecond] = useState(known.find((run) => run.job.id === shown)?.job.id ?? known[0]?.job.id ?? "");
  if (known.length < 2) return null;
  const data = known.map((run) => ({ value: run.job.id, label: title(run, runs) }));
  return (
    <Section title="Compare two runs">
      <div className={css.compareHead}>
        <NativeSelect
          size="xs"
          label="From"
          data={data}
          value={firstId}
          onChange={(event) => setFirst(event.currentTarget.value)}
        />
        <NativeSelect
          size="xs"
          label="to"
          data={data}
          value={secondId}
          onChange={(event) => setSecond(event.currentTarget.value)}
        />
      </div>
      <Differences firstId={firstId} secondId={secondId} />
    </Section>
  );
}

function Differences({ firstId, secondId }: { firstId: string; secondId: string }) {
  const first = useQuery(resultQuery(firstId));
  const second = useQuery(resultQuery(secondId));
  if (first.isPending || second.isPending) return <Skeleton height={180} />;
  if (first.isError || second.isError) return <Fault error={first.error ?? second.error} />;
  const found = differences(first.data, second.data);
  if (found === null) return <p className="dim small">One of them has no answer to compare.</p>;
  return (
    <>
      <table className={css.compare}>
        <caption className="sr-only">Differences of the two runs with one standard deviation</caption>
        <tbody>
          {found.map(({ name, unit, value, sigma }) => {
            const text = withSigma(value, sigma);
            const times = sigma > 0 ? Math.abs(value) / sigma : 0;
            return (
              <tr key={name} data-apart={times > apart}>
                <th scope="row">{name}</th>
                <td className="num">{text.value}</td>
                <td className="num">± {text.sigma}</td>
                <td>{unit}</td>
                <td className="num">{fixed(times, 1)} σ</td>
              </tr>
            );
          })}
        </tbody>
      </table>
      <p className="dim small">
        σ is of the difference, as if each run had a recording of its own; turns are about the lidar&rsquo;s axes.
      </p>
    </>
  );
}
