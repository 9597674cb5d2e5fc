import type { Job, Recording, SolveOutcome } from "../../api/client";
import { isFinal } from "../../api/jobstream";
import type { Tone } from "../../ui/icons";
import { verdictTones } from "../audit/words";

interface Standing {
  tone: Tone;
  text: string;
  screen: "recording" | "audit" | "planes" | "solve" | "result";
  /** The run that the screen is to show, where that is not the newest. */
  job?: string;
}

const auditWords = { passed: "Audit passed", failed: "Audit failed", unknown: "Audit cannot tell" };

function standingOfSolve(state: Job["state"]): Pick<Standing, "tone" | "text"> {
  switch (state) {
    case "failed":
      return { tone: "error", text: "Solve failed" };
    case "cancelled":
      return { tone: "warning", text: "Solve cancelled" };
    case "interrupted":
      return { tone: "warning", text: "Solve interrupted" };
    case "queued":
      return { tone: "info", text: "Waiting to be solved" };
    case "running":
    case "cancelling":
    case "done":
      return { tone: "info", text: "Solving" };
  }
}

/** How a run ended that came to nothing. */
const endings: Partial<Record<Job["state"], string>> = {
  failed: "failed",
  cancelled: "was cancelled",
  interrupted: "was interrupted",
};

function standingOfOutcome(outcome: SolveOutcome): Standing {
  switch (outcome.status) {
    case "calibrated":
      return {
        tone: outcome.tone === "doubtful" ? "warning" : "good",
        text: outcome.tone === "doubtful" ? "Calibrated, but it disagrees with itself" : "Calibrated",
        screen: "result",
      };
    case "weak":
      return { tone: "warning", text: "Weak", screen: "result" };
    case "refused":
      return { tone: "error", text: "Refused", screen: "result" };
  }
}

/** True whether its page is still sending or was closed, which nobody but that page knows. */
function comingIn({ origin, received_bytes: here, size_bytes: all }: Recording): string {
  if (origin === "sample") return "Being made";
  return `Upload at ${all === 0 ? 0 : Math.floor((100 * here) / all)} %`;
}

/** Why a recording has not been read: what was stopped says nothing of it. */
function unread(state: Job["state"] | undefined): Pick<Standing, "tone" | "text"> {
  if (state !== "interrupted" && state !== "cancelled") return { tone: "error", text: "Cannot be read" };
  return { tone: "warning", text: `Reading ${endings[state] ?? ""}` };
}

/** Where a recording stands, in two words, and the screen to go on with. */
export function standingOf(recording: Recording): Standing {
  switch (recording.state) {
    case "receiving":
      return { tone: "info", text: comingIn(recording), screen: "recording" };
    case "inspecting":
      return { tone: "info", text: "Being read", screen: "recording" };
    case "failed":
      return { ...unread(recording.latest_job?.state), screen: "recording" };
    case "ready":
      break;
  }
  const job = recording.latest_job;
  const outcome = job?.result;
  const answer = recording.latest_answer ?? null;
  // What came to nothing since takes nothing from an answer that is there.
  if (
    job?.kind === "solve" &&
    isFinal(job) &&
    answer !== null &&
    answer.id !== job.id &&
    answer.result?.kind === "solve"
  ) {
    const since = outcome?.kind === "solve" ? "was refused" : endings[job.state];
    if (since !== undefined) {
      const stands = standingOfOutcome(answer.result);
      return { ...stands, tone: "warning", text: `${stands.text}; a later run ${since}`, job: answer.id };
    }
  }
  if (outcome?.kind === "solve") return standingOfOutcome(outcome);
  if (outcome?.kind === "audit")
    return { tone: verdictTones[outcome.verdict], text: auditWords[outcome.verdict], screen: "audit" };
  if (job?.kind === "audit" && !isFinal(job)) return { tone: "info", text: "Being audited", screen: "audit" };
  if (job?.kind === "solve") return { ...standingOfSolve(job.state), screen: "solve" };
  switch (recording.verdict) {
    case "good":
      return { tone: "good", text: "Good to calibrate", screen: "recording" };
    case "limited":
      return { tone: "warning", text: "Usable, with limits", screen: "recording" };
    case "unusable":
      return { tone: "error", text: "Not usable as it is", screen: "recording" };
    case null:
    case undefined:
      return { tone: "info", text: "Read", screen: "recording" };
  }
}

export type Order = "newest" | "name" | "largest" | "standing";
const tones: readonly Tone[] = ["good", "warning", "error", "info"];

/** The recordings that have all the words in their name, state or note, in the wanted order. */
export function listed(recordings: readonly Recording[], wanted: string, order: Order): Recording[] {
  const words = wanted
    .toLowerCase()
    .split(/\s+/)
    .filter((word) => word !== "");
  const found = recordings.filter((recording) => {
    const text = `${recording.name} ${standingOf(recording).text} ${recording.note}`.toLowerCase();
    return words.every((word) => text.includes(word));
  });
  switch (order) {
    case "newest":
      return found.sort((a, b) => b.created_at.localeCompare(a.created_at));
    case "name":
      return found.sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));
    case "largest":
      return found.sort((a, b) => b.size_bytes - a.size_bytes);
    case "standing":
      return found.sort((a, b) => tones.indexOf(standingOf(a).tone) - tones.indexOf(standingOf(b).tone));
  }
}
