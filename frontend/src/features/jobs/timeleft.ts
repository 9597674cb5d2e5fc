import type { Job } from "../../api/client";
import { isFinal, type StageProgress } from "../../api/jobstream";

type Stage = StageProgress["stage"];

/** Share of a solve's time that each stage usually takes; only the ratios matter. */
const weights: Record<Stage, number> = {
  read: 2,
  inspect: 2,
  planes: 1,
  track: 2,
  initialise: 0.3,
  associate: 1,
  solve: 10,
  observability: 1,
  deskew: 2,
  write: 0.3,
};

export const stagesOfPlanes: readonly Stage[] = ["read", "planes"];
/** All that a solve may have to do: what an earlier run has made is passed over. */
export const stagesOfSolve: readonly Stage[] = ["read", "planes", "track", "initialise", "solve", "deskew"];

/** The stages of a run: one that was passed over is none, since what it makes was kept from an earlier run. */
export function stagesOf(seen: readonly StageProgress[], expected: readonly Stage[]): Stage[] {
  const latest = Math.max(-1, ...seen.map((stage) => expected.indexOf(stage.stage)));
  return expected.filter((stage, i) => i > latest || seen.some((other) => other.stage === stage));
}

/** In the order in which they come: those seen, whether they were expected or not, and then those still expected. */
export function stagesShown(seen: readonly StageProgress[], expected: readonly Stage[]): Stage[] {
  return [...new Set([...seen.map((stage) => stage.stage), ...stagesOf(seen, expected)])];
}

/** How much of the whole job is done, 0..1, from the stages seen and those still expected. */
export function wholeFraction(seen: readonly StageProgress[], expected: readonly Stage[]): number {
  // What comes after a stage says that it is done, whatever it said last.
  const share = (stage: StageProgress, place: number) =>
    place < seen.length - 1 ? 1 : Math.min(1, Math.max(0, stage.fraction));
  const weight = (name: Stage) => (seen.some(({ stage, kept }) => stage === name && kept) ? 0 : weights[name]);
  const done = seen.reduce((sum, stage, place) => sum + weight(stage.stage) * share(stage, place), 0);
  const all = stagesShown(seen, expected).reduce((sum, stage) => sum + weight(stage), 0);
  return all > 0 ? done / all : 0;
}

/** After so long without a word the page says how long this step has taken: the usual one takes a few seconds. */
const longStepS = 20;
/** And after so long that something may be wrong: the longest step of a long recording on a slow machine takes less. */
const silenceS = 180;

/** Seconds since a run last said anything, where that is long enough to be told; null otherwise. */
export function longStep(heardAtMs: number | null, nowMs: number): number | null {
  return silentFor(heardAtMs, nowMs, longStepS);
}

/** Seconds since a run last said anything, where that is long enough to worry; null otherwise. */
export function stalledS(heardAtMs: number | null, nowMs: number): number | null {
  return silentFor(heardAtMs, nowMs, silenceS);
}

function silentFor(heardAtMs: number | null, nowMs: number, leastS: number): number | null {
  if (heardAtMs === null) return null;
  const silentS = (nowMs - heardAtMs) / 1000;
  return silentS >= leastS ? silentS : null;
}

/** What is done of a run tells its pace from here on: the start goes faster than its rounds do. */
const tellingFraction = 0.2;
/** So many times what was said, and saying it again would be no help. */
const brokenBeyond = 2;

/** Seconds until the end at the pace so far; null while it is too early to say. */
export function secondsLeft(fraction: number, elapsedS: number): number | null {
  if (fraction < tellingFraction || elapsedS < 1) return null;
  return (elapsedS * (1 - fraction)) / fraction;
}

/** What is said of the time left, given what was said before: it never rises. Null where that would be far from the truth, until
 *  the run has caught up.
 */
export function promised(before: number | null, now: number | null): number | null {
  if (before === null || now === null || now <= before) return now;
  return now > brokenBeyond * before ? null : before;
}

export type StageState = "waiting" | "active" | "done" | "stopped";

/** Where a stage of a run stands: what was under way when a run was stopped or failed is not done. */
export function stageState(
  seen: StageProgress | undefined,
  active: StageProgress | undefined,
  job: Job | null,
): StageState {
  if (seen === undefined) return "waiting";
  if (seen !== active || seen.fraction >= 1 || job?.state === "done") return "done";
  return job !== null && isFinal(job) ? "stopped" : "active";
}

/** What became of a run, in a word or two; "Solve" while that is not known yet. */
export function standingOf(job: Job | null): string {
  switch (job?.state) {
    case undefined:
      return "Solve";
    case "done":
      return job.result?.kind === "solve" && job.result.status === "refused" ? "Refused" : "Solved";
    case "failed":
      return "The solve failed";
    case "cancelled":
      return "Cancelled";
    case "interrupted":
      return "Interrupted";
    case "queued":
      return "Waiting";
    case "running":
    case "cancelling":
      return "Solving";
  }
}

/** What is said of an ended run below its standing: the verdict, without the word that stands there already. */
export function saidBelow(job: Job | null, verdict: string): string {
  const word = `${standingOf(job)}. `;
  return verdict.startsWith(word) ? verdict.slice(word.length) : verdict;
}
