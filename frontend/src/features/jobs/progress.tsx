import { Button } from "@mantine/core";
import { useState } from "react";
import { isFinal, type RunLog, type StageProgress } from "../../api/jobstream";
import { useCancelJob } from "../../api/changes";
import { useNow } from "../../ui/clock";
import { duration, percentOf } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import css from "./progress.module.css";
import { longStep, promised, secondsLeft, stagesShown, stageState, stalledS, wholeFraction } from "./timeleft";

export const stageTitles: Record<StageProgress["stage"], string> = {
  read: "Read the recording",
  inspect: "Examine it",
  planes: "Find planes",
  track: "Follow planes through the scans",
  initialise: "Start values",
  associate: "Assign points to planes",
  solve: "Joint solve, in rounds",
  observability: "What is determined, and how well",
  deskew: "Take the motion out, measure the walls",
  write: "Write the result",
};

interface JobProgressProps {
  run: RunLog;
  jobId: string;
  expected?: readonly StageProgress["stage"][];
  /** What this job calls a stage where the usual words do not fit it. */
  titles?: Partial<typeof stageTitles>;
}

/** The largest of the numbers seen so far for a key: what has been done stays done. */
function useHighest(key: string, value: number): number {
  const [highest, setHighest] = useState({ key, value });
  const reached = highest.key === key ? Math.max(highest.value, value) : value;
  if (highest.key !== key || highest.value !== reached) setHighest({ key, value: reached });
  return reached;
}

/** The least that was said of the time left of a job, and null while that is far from the truth. */
function usePromised(key: string, left: number | null): number | null {
  const [before, setBefore] = useState({ key, left });
  const least = before.key === key ? before.left : null;
  const said = promised(least, left);
  const next = said ?? least;
  if (before.key !== key || before.left !== next) setBefore({ key, left: next });
  return said;
}

/** Where a job stands that waits. */
function waitingText(place: number | null | undefined): string {
  if (place == null) return "Waiting for a free slot";
  return place === 1 ? "Waiting, next in the queue" : `Waiting, place ${place} in the queue`;
}

const stageWords = { waiting: ", waiting", active: ", running", done: ", done", stopped: ", not finished" };

/** One job as it runs: what it is doing, how far it is, how long it will take, and the way to stop it. */
export function JobProgress({ run, jobId, expected = [], titles = {} }: JobProgressProps) {
  const cancel = useCancelJob();
  const running = run.job === null || !isFinal(run.job);
  const now = useNow(500, running);
  const startedAt = run.job?.started_at;
  const began = startedAt === null || startedAt === undefined ? null : Date.parse(startedAt);
  const ended = run.job?.ended_at;
  const elapsedS =
    began === null
      ? 0
      : Math.max(0, ((ended === null || ended === undefined ? now : Date.parse(ended)) - began) / 1000);
  const stages = run.stages;
  const fraction = useHighest(jobId, run.job?.state === "done" ? 1 : wholeFraction(stages, expected));
  const refused = run.job?.result?.kind === "solve" && run.job.result.status === "refused";
  const queued = run.job?.state === "queued";
  const stalled = running && !queued ? stalledS(run.heardAtMs, now) : null;
  const step = running && !queued ? longStep(run.heardAtMs, now) : null;
  // While a step takes longer than it should, so will the rest: nothing is promised.
  const left = usePromised(jobId, running && step === null ? secondsLeft(fraction, elapsedS) : null);
  const active = stages.at(-1);
  const names = stagesShown(stages, running ? expected : []);
  const percent = percentOf(fraction);
  return (
    <div className={css.progress}>
      <div className={css.progressHead}>
        {!queued && <span className="num">{running ? `${percent} %` : duration(elapsedS)}</span>}
        <span className="dim small">
          {queued
            ? waitingText(run.job?.queue_place)
            : stalled !== null
              ? `nothing new for ${duration(stalled)}`
              : running
                ? left === null
                  ? `${duration(elapsedS)} so far`
                  : `about ${duration(left)} left`
                : refused
                  ? "It ended without an answer"
                  : run.job?.state === "done"
                    ? run.job.state_text
                    : ""}
        </span>
        {running && (
          <Button
            size="compact-sm"
            variant="default"
            leftSection={<Icon name="cross" size={12} />}
            loading={cancel.isPending || run.job?.state === "cancelling"}
            onClick={() => cancel.mutate(jobId)}
          >
            Cancel
          </Button>
        )}
      </div>
      <div
        className={css.bar}
        data-refused={refused}
        role="progressbar"
        aria-label="Progress"
        aria-valuenow={percent}
        aria-valuemin={0}
        aria-valuemax={100}
        {...(queued ? { "aria-valuetext": "waiting" } : {})}
      >
        <span style={{ transform: `scaleX(${fraction})` }} />
      </div>
      {cancel.isError && <Fault error={cancel.error} />}
      <ol className={css.stages}>
        {names.map((name) => {
          const seen = stages.find((stage) => stage.stage === name);
          const state = refused && seen === active ? "stopped" : stageState(seen, active, run.job);
          return (
            <li key={name} data-state={state}>
              <span className={css.dot} aria-hidden="true">
                {state === "done" && <Icon name="check" size={11} />}
                {state === "stopped" && <Icon name="cross" size={9} />}
              </span>
              <span>
                {titles[name] ?? stageTitles[name]}
                <span className="sr-only">{stageWords[state]}</span>
              </span>
              <span
                className="num dim"
                {...(seen?.kept === true ? { title: "Done by an earlier run of this recording, and used again" } : {})}
              >
                {seen?.kept === true
                  ? "kept from before"
                  : state === "active" && seen !== undefined
                    ? `${percentOf(seen.fraction)} %`
                    : ""}
              </span>
            </li>
          );
        })}
      </ol>
      <p className={css.stageText} aria-live="polite">
        {running && !queued ? (active?.text ?? "Starting") : ""}
      </p>
      {stalled !== null ? (
        <p className={css.stageText}>
          It has said nothing for {duration(stalled)}. It may still be at a hard part; cancel it if this goes on.
        </p>
      ) : (
        step !== null && (
          <p className={css.stageText}>This step has taken {duration(step)} so far; it is still working.</p>
        )
      )}
    </div>
  );
}
