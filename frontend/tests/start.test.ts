import { describe, expect, it } from "vitest";
import type { Job, Recording } from "../src/api/client";
import { standingOf } from "../src/features/start/standing";

const solving = (state: Job["state"]) =>
  ({ state: "ready", latest_job: { kind: "solve", state, result: null } }) as unknown as Recording;

describe("where a recording stands", () => {
  // Fails when every solve without an answer counts as one that runs.
  it("does not call a stopped solve solving", () => {
    expect(standingOf(solving("running")).text).toBe("Solving");
    expect(standingOf(solving("cancelled")).text).toBe("Solve cancelled");
    expect(standingOf(solving("interrupted")).text).toBe("Solve interrupted");
    expect(standingOf(solving("failed")).tone).toBe("error");
  });

  // Seen: a server that was stopped meanwhile. Fails when what was not read for that is called unreadable.
  it("does not blame a recording whose reading was stopped", () => {
    const unread = (state: string | undefined) =>
      standingOf({
        state: "failed",
        latest_job: state && { kind: "inspect", state, result: null },
      } as unknown as Recording);
    expect(unread("interrupted")).toEqual({ tone: "warning", text: "Reading was interrupted", screen: "recording" });
    expect(unread("cancelled").text).toBe("Reading was cancelled");
    for (const state of ["failed", undefined]) {
      expect(unread(state)).toEqual({ tone: "error", text: "Cannot be read", screen: "recording" });
    }
  });

  // Fails when a run that came to nothing hides the answer that the result's page has, or leads to the page of another run.
  it("keeps an answer whatever was tried since", () => {
    const solve = (id: string, status: string | null, state = "done") => ({
      id,
      kind: "solve",
      state,
      result: status === null ? null : { kind: "solve", status, tone: "good" },
    });
    const of = (latest_job: unknown, latest_answer: unknown) =>
      standingOf({ state: "ready", latest_job, latest_answer } as unknown as Recording);
    const answer = solve("a", "calibrated");
    expect(of(solve("b", "refused"), answer)).toEqual({
      tone: "warning",
      text: "Calibrated; a later run was refused",
      screen: "result",
      job: "a",
    });
    expect(of(solve("b", null, "cancelled"), answer).text).toBe("Calibrated; a later run was cancelled");
    expect(of(solve("b", null, "running"), answer).text).toBe("Solving");
    expect(of(answer, answer)).toEqual({ tone: "good", text: "Calibrated", screen: "result" });
    expect(of(solve("b", "refused"), null).text).toBe("Refused");
  });

  // Fails when an upload whose page was closed is called one that goes on, and a sample one that is sent.
  it("tells how much is here, whoever sends it", () => {
    const coming = (origin: Recording["origin"], here: number) =>
      ({ state: "receiving", origin, received_bytes: here, size_bytes: 1000 }) as Recording;
    expect(standingOf(coming("upload", 439)).text).toBe("Upload at 43 %");
    expect(standingOf({ ...coming("upload", 0), size_bytes: 0 }).text).toBe("Upload at 0 %");
    expect(standingOf(coming("sample", 0)).text).toBe("Being made");
  });
});
