import type { Job, Planes, Recording, Run } from "../../api/client";
import { isFinal } from "../../api/jobstream";
import type { Step } from "../../ui/stepper";
import { determines } from "../planes/determinacy";
import { lacksSensor } from "../recording/sensors";
import { lookOf, type Looked, type Seen } from "./seen";

/** The runs that ended with a document to show, newest first. */
export function finishedRuns(runs: readonly Run[]): Run[] {
  return runs.filter((run) => run.job.state === "done" && run.job.result?.kind === "solve");
}

/** The run a screen is about: the one named in the URL, else the newest with a document. */
export function chosenRun(runs: readonly Run[], jobId: string | null): Run | undefined {
  const finished = finishedRuns(runs);
  return finished.find((run) => run.job.id === jobId) ?? finished[0];
}

export function isRefused(run: Run): boolean {
  return run.job.result?.kind === "solve" && run.job.result.status === "refused";
}

function busy(job: Job | null | undefined, kind: Job["kind"]): boolean {
  return job !== null && job !== undefined && job.kind === kind && !isFinal(job);
}

/** Whether a recording can be called so: the API's document has the same pattern. */
export function isRecordingId(text: string): boolean {
  return /^[0-9a-f]{32}$/.test(text);
}

/** Whether its bytes are here and can be looked at, whatever is still being found out about them. */
export function hasArrived(recording: Recording | undefined): boolean {
  return recording?.state === "ready" || recording?.state === "inspecting";
}

/** What cannot be used is not done with. */
function recordingState(recording: Recording | undefined): Step["state"] {
  switch (recording?.state) {
    case "receiving":
    case "inspecting":
      return "busy";
    case "ready":
      return recording.report?.verdict === "unusable" ? "open" : "done";
    case "failed":
    case undefined:
      return "open";
  }
}

/** Which steps can be entered, which are done, and why the others wait.
 *
 *  Done is what was done, not what could be: planes are once a solve was asked for with such as determine the answer, and an
 *  answer is looked at once somebody has looked at it. */
export function stepsOf(
  recording: Recording | undefined,
  planes: Planes | undefined,
  runs: readonly Run[],
  query: string,
  seen: Seen = new Set(),
): Step[] {
  const base = recording === undefined ? undefined : `/r/${recording.id}`;
  const to = (name: string) => (base === undefined ? {} : { to: `${base}/${name}${query}` });
  const lacking = lacksSensor(recording?.report);
  const arrived = hasArrived(recording) && !lacking;
  const job = recording?.latest_job;
  const solved = finishedRuns(runs);
  const newest = solved[0];
  const solving = busy(job, "solve");
  const lookedAt = (what: Looked, run: Run) => (seen.has(lookOf(what, run.job.id)) ? "done" : "open");
  const waits = lacking ? "This recording lacks one of the two sensors" : "The recording has to be read first";
  return [
    {
      name: "recording",
      state: recordingState(recording),
      ...to("recording"),
    },
    arrived
      ? {
          name: "planes",
          state:
            busy(job, "planes") && planes === undefined
              ? "busy"
              : runs.length > 0 && planes !== undefined && determines(planes)
                ? "done"
                : "open",
          ...to("planes"),
        }
      : { name: "planes", state: "locked", reason: waits },
    arrived && (planes !== undefined || newest !== undefined || solving)
      ? {
          name: "solve",
          state: solving ? "busy" : newest === undefined || isRefused(newest) ? "open" : "done",
          ...to("solve"),
        }
      : { name: "solve", state: "locked", reason: arrived ? "Planes have to be found first" : waits },
    newest !== undefined && !isRefused(newest)
      ? { name: "inspect", state: lookedAt("inspect", newest), ...to("inspect") }
      : {
          name: "inspect",
          state: "locked",
          reason: solving ? "The solve is still running" : "There is no answer to look at yet",
        },
    newest !== undefined
      ? { name: "result", state: lookedAt("result", newest), ...to("result") }
      : { name: "result", state: "locked", reason: solving ? "The solve is still running" : "There is no result yet" },
  ];
}
