import { Button, NativeSelect, Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link } from "react-router";
import type { CalibrationResult, Recording, Run } from "../../api/client";
import { recordingsQuery, resultQuery } from "../../api/queries";
import { fixed, plusMinus, withSigma } from "../../ui/format";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import { writeOld } from "../inspect/oldtext";
import { calledRun } from "./history";
import { apart, differences, inSigmas, isApart } from "./difference";
import css from "./result.module.css";

/** Where even three standard deviations are wider than this, agreement says nothing: what audits allow by themselves. */
const telling = { "°": 0.5, mm: 20, ms: 2 } as const;

interface CompareProps {
  recording: Recording;
  runs: readonly Run[];
  shown: string;
}

function answered(run: Run): boolean {
  return !run.error && run.job.result?.kind === "solve" && run.job.result.translation_m !== null;
}

function title(run: Run, runs: readonly Run[]): string {
  const when = new Date(run.job.created_at).toLocaleString(undefined, { dateStyle: "short", timeStyle: "short" });
  return `${calledRun(run, runs)}, ${run.job.settings.method === "paper" ? "as published" : "full"}, ${when}`;
}

/** The newest answers of other recordings: the same rig on another day, or another rig. */
function useOthers(recording: Recording): { value: string; label: string }[] {
  const recordings = useQuery(recordingsQuery).data ?? [];
  return recordings
    .filter((one) => one.id !== recording.id)
    .flatMap((one) => {
      const job = one.latest_answer ?? one.latest_job;
      if (job?.result?.kind !== "solve" || job.result.translation_m === null) return [];
      return [{ value: job.id, label: one.name }];
    });
}

interface Sides {
  from: string | null;
  to: string;
}

/** Which two are compared, before and after something was chosen; null where this recording has no answer.
 *
 *  The run that is shown, from another of this recording: of another recording's rig nobody said that it is the same, so one of
 *  those has to be chosen. Never an answer with itself, which always agrees.
 */
export function sidesOf(
  known: readonly string[],
  shown: string,
  first: string | null,
  second: string | null,
): Sides | null {
  const free = known.filter((id) => id !== first);
  const to = second ?? (free.includes(shown) ? shown : (free[0] ?? known[0]));
  if (to === undefined) return null;
  return { from: (first === to ? null : first) ?? known.find((id) => id !== to) ?? null, to };
}

/** Any two answers side by side: what differs, whether by more than both are unsure of, and both clouds. */
export function Compare({ recording, runs, shown }: CompareProps) {
  const known = runs.filter(answered);
  const others = useOthers(recording);
  const mine = known.map((run) => ({ value: run.job.id, label: title(run, runs) }));
  const [first, setFirst] = useState<string | null>(null);
  const [second, setSecond] = useState<string | null>(null);
  const sides = sidesOf(
    known.map((run) => run.job.id),
    shown,
    first,
    second,
  );
  if (sides === null || mine.length + others.length < 2) return null;
  const { from, to } = sides;
  const names = new Map([
    ...known.map((run) => [run.job.id, calledRun(run, runs)] as const),
    ...others.map(({ value, label }) => [value, label] as const),
  ]);
  const without = (id: string | null) => [
    { group: "This recording", items: mine.map((item) => ({ ...item, disabled: item.value === id })) },
    ...(others.length === 0
      ? []
      : [{ group: "Other recordings", items: others.map((item) => ({ ...item, disabled: item.value === id })) }]),
  ];
  return (
    <Section title="Compare two answers">
      <div className={css.compareHead}>
        <NativeSelect
          size="xs"
          label="From"
          data={
            from === null ? [{ value: "", label: "Choose an answer", disabled: true }, ...without(to)] : without(to)
          }
          value={from ?? ""}
          onChange={(event) => setFirst(event.currentTarget.value)}
        />
        <NativeSelect
          size="xs"
          label="To"
          data={without(from)}
          value={to}
          onChange={(event) => setSecond(event.currentTarget.value)}
        />
      </div>
      {from === null ? (
        <p className="dim small">
          Choose the answer to compare with: of this recording, or of another one of the same rig.
        </p>
      ) : (
        <Differences firstId={from} secondId={to} recording={recording} runs={known} names={names} />
      )}
    </Section>
  );
}

interface DifferencesProps {
  firstId: string;
  secondId: string;
  recording: Recording;
  runs: readonly Run[];
  /** What the scene calls each of them. */
  names: ReadonlyMap<string, string>;
}

function Differences({ firstId, secondId, recording, runs, names }: DifferencesProps) {
  const first = useQuery(resultQuery(firstId));
  const second = useQuery(resultQuery(secondId));
  if (first.isPending || second.isPending) return <Skeleton height={180} />;
  if (first.isError || second.isError) return <Fault error={first.error ?? second.error} />;
  const found = differences(first.data, second.data);
  if (found === null) return <p className="dim small">One of them has no answer to compare.</p>;
  const far = found.filter(isApart);
  const blind = found.filter(({ unit, sigma }) => apart * sigma > telling[unit]);
  // The clouds of this recording, de-skewed with the one and with the other.
  const here = runs.find((run) => run.job.id === secondId) ?? runs.find((run) => run.job.id === firstId);
  const [other, otherId] = here?.job.id === secondId ? [first.data, firstId] : [second.data, secondId];
  return (
    <>
      <p>
        {far.length === 0
          ? blind.length === 0
            ? "They agree: nothing differs by three standard deviations or more."
            : `Nothing differs by three standard deviations or more, but those are too wide to tell in ${blind.map(({ name }) => name.toLowerCase()).join(", ")}.`
          : `They differ by three standard deviations or more in ${far.map(({ name }) => name.toLowerCase()).join(", ")}.`}
      </p>
      <table className={css.compare}>
        <caption className="sr-only">Differences of the two answers with one standard deviation</caption>
        <tbody>
          {found.map((difference) => {
            const { name, unit, value, sigma } = difference;
            const text = withSigma(value, sigma, unit);
            return (
              <tr key={name} data-apart={isApart(difference)}>
                <th scope="row">{name}</th>
                <td className="num">{text.value}</td>
                <td className="num">{plusMinus(text)}</td>
                <td>{text.unit}</td>
                <td className="num">{fixed(inSigmas(difference), 1)} σ</td>
              </tr>
            );
          })}
        </tbody>
      </table>
      <p className="dim small">
        σ is of the difference, as if each run had a recording of its own; turns are about the lidar&rsquo;s axes.
      </p>
      {here !== undefined && (
        <Button
          component={Link}
          to={`/r/${recording.id}/inspect?${cloudsQuery(here.job.id, other, names.get(otherId) ?? "")}`}
          variant="default"
          size="compact-sm"
        >
          See both clouds
        </Button>
      )}
    </>
  );
}

/** A name that fits a button. */
function short(name: string): string {
  return name.length > 24 ? `${name.slice(0, 23)}…` : name;
}

/** Inspect, with one answer as the run's own and the other as the extrinsic beside it. */
export function cloudsQuery(
  jobId: string,
  other: Pick<CalibrationResult, "T_imu_lidar" | "time_offset_s">,
  name: string,
) {
  const pose = other.T_imu_lidar;
  const query = new URLSearchParams({ job: jobId, show: "side", against: "old", map: "1" });
  if (pose !== null) {
    const { translation_m, quaternion_xyzw } = pose;
    query.set(
      "old",
      writeOld({ translation_m, quaternion_xyzw, time_offset_s: other.time_offset_s, name: short(name) }),
    );
  }
  return query.toString();
}
