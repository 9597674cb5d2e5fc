import { useEffect, useReducer } from "react";
import { spoken } from "../ui/words";
import type { IterationEvent, Job, JobMessage, LogEvent, StageEvent } from "./client";

export interface StageProgress {
  stage: StageEvent["stage"];
  fraction: number;
  text: string;
  /** Whether nothing had to be done, as an earlier run had. */
  kept: boolean;
}

/** What is known of a run from its messages. */
export interface RunLog {
  job: Job | null;
  /** In the order in which they began. */
  stages: StageProgress[];
  iterations: IterationEvent[];
  logs: LogEvent[];
  /** When it last said something, by this browser's clock; null before that. */
  heardAtMs: number | null;
}

export const emptyRun: RunLog = { job: null, stages: [], iterations: [], logs: [], heardAtMs: null };

/** The run after some more messages. */
export function addMessages(run: RunLog, messages: readonly JobMessage[]): RunLog {
  const next: RunLog = { ...run, stages: [...run.stages], iterations: [...run.iterations], logs: [...run.logs] };
  for (const message of messages) {
    switch (message.event) {
      case "stage": {
        const entry = { stage: message.stage, fraction: message.fraction, text: message.text, kept: message.kept };
        const at = next.stages.findIndex((one) => one.stage === message.stage);
        const known = next.stages[at];
        if (known === undefined) next.stages.push(entry);
        // A stage that is gone through again does not undo what it has done.
        else next.stages[at] = { ...entry, fraction: Math.max(known.fraction, entry.fraction) };
        break;
      }
      case "iteration":
        next.iterations.push(message);
        break;
      case "log":
        next.logs.push(message);
        // Its worker was lost: another one begins anew, and what the first had reached is no longer on the way to the answer.
        if (message.code === "job.moved") {
          next.stages = [];
          next.iterations = [];
        }
        break;
      case "state":
        next.job = message.job;
        break;
    }
  }
  return next;
}

export function isFinal(job: Job): boolean {
  switch (job.state) {
    case "done":
    case "failed":
    case "cancelled":
    case "interrupted":
      return true;
    case "queued":
    case "running":
    case "cancelling":
      return false;
  }
}

type Step = { jobId: string | null } | { messages: JobMessage[]; atMs: number };
const updateEveryMs = 100;

function reduce(run: RunLog, step: Step): RunLog {
  return "messages" in step ? { ...addMessages(run, step.messages), heardAtMs: step.atMs } : emptyRun;
}

/** All messages of a job, from its first to its last, drawn at most ten times a second. */
export function useJobStream(jobId: string | null): RunLog {
  const [run, dispatch] = useReducer(reduce, emptyRun);
  useEffect(() => {
    dispatch({ jobId });
    if (jobId === null) return;
    const source = new EventSource(`/api/jobs/${jobId}/events`);
    let waiting: JobMessage[] = [];
    const flush = () => {
      if (waiting.length === 0) return;
      dispatch({ messages: waiting, atMs: Date.now() });
      waiting = [];
    };
    const timer = window.setInterval(flush, updateEveryMs);
    source.onmessage = (event: MessageEvent<string>) => {
      const message = spoken(JSON.parse(event.data) as JobMessage);
      waiting.push(message);
      if (message.event === "state" && isFinal(message.job)) {
        source.close();
        flush();
      }
    };
    return () => {
      window.clearInterval(timer);
      source.close();
    };
  }, [jobId]);
  return run;
}
