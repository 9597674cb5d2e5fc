import { describe, expect, it } from "vitest";
import type { Planes, Recording, Run } from "../src/api/client";
import { whyNothing } from "../src/features/inspect/screen";
import { lookOf } from "../src/features/workspace/seen";
import document from "../openapi.json";
import { isRecordingId, stepsOf } from "../src/features/workspace/state";

const recording = { id: "ab", state: "ready", latest_job: null } as unknown as Recording;
const planes = { determinacy: { ok: true, text: "", smallest_eigenvalue: 1 }, foreseen: null } as unknown as Planes;
const run = (status: string) =>
  ({ job: { id: "j1", kind: "solve", state: "done", result: { kind: "solve", status } } }) as unknown as Run;

const ticked = (...asked: Parameters<typeof stepsOf>) =>
  stepsOf(...asked)
    .filter((step) => step.state === "done")
    .map((step) => step.name);

describe("while a solve runs", () => {
  const solving = { ...recording, latest_job: { kind: "solve", state: "running" } } as unknown as Recording;

  // Fails when who has started a solve is asked for one.
  it("says that it runs, and not that there is none", () => {
    const reasons = (of: Recording) => stepsOf(of, planes, [], "").flatMap(({ reason }) => reason ?? []);
    expect(reasons(solving)).toEqual(["The solve is still running", "The solve is still running"]);
    expect(reasons(recording)).toEqual(["There is no answer to look at yet", "There is no result yet"]);
    expect(whyNothing(undefined, solving)).toMatch(/^The solve is still running/);
    expect(whyNothing(undefined, recording)).toMatch(/^Solve first/);
    expect(whyNothing(run("refused"), recording)).toMatch(/refused/);
  });
});

describe("a recording without one of the sensors", () => {
  const report = { final: true, verdict: "unusable", lidar: {}, lidar_candidates: ["/points"], imu: null };
  const without = { ...recording, report: { ...report, imu_candidates: [] } } as unknown as Recording;
  const toChoose = { ...recording, report: { ...report, imu_candidates: ["/a", "/b"] } } as unknown as Recording;

  // Seen: without an IMU, Recording had a tick and "Choose planes" led to a page that waits for ever. Fails when what cannot be used
  // is ticked off, when a step is open that leads nowhere, or when one of which an IMU has yet to be chosen is taken for such.
  it("opens no step after it, and is not done with", () => {
    expect(ticked(without, undefined, [], "")).toEqual([]);
    expect(stepsOf(without, undefined, [], "").map(({ state }) => state)).toEqual([
      "open",
      ...Array<string>(4).fill("locked"),
    ]);
    expect(stepsOf(without, undefined, [], "")[1]?.reason).toMatch(/lacks one of the two sensors/);
    expect(stepsOf(toChoose, undefined, [], "")[1]?.state).toBe("open");
  });
});

describe("the steps' ticks", () => {
  // Fails when what was only suggested, or could be looked at, counts as done.
  it("are for what was done", () => {
    expect(ticked(recording, planes, [], "")).toEqual(["recording"]);
    expect(ticked(recording, planes, [run("calibrated")], "")).toEqual(["recording", "planes", "solve"]);
    const seen = new Set([lookOf("inspect", "j1"), lookOf("result", "another")]);
    expect(ticked(recording, planes, [run("calibrated")], "", seen)).toEqual([
      "recording",
      "planes",
      "solve",
      "inspect",
    ]);
  });

  // Fails when a refusal is a solve that is done; when planes that no longer determine the answer keep their tick.
  it("go where it came to nothing", () => {
    const seen = new Set([lookOf("result", "j1")]);
    expect(ticked(recording, planes, [run("refused")], "", seen)).toEqual(["recording", "planes", "result"]);
    const loose = { ...planes, determinacy: { ...planes.determinacy, ok: false } };
    expect(ticked(recording, loose, [run("calibrated")], "")).toEqual(["recording", "solve"]);
  });
});

// Seen: of a link that was cut off the page said that a string should match a pattern. Fails when one reaches the server, or when the
// server draws ids that the page takes for none.
it("knows an address that is cut off", () => {
  const [parameter] = document.paths["/api/recordings/{recording_id}"].get.parameters;
  const served = new RegExp(parameter?.schema.pattern ?? "");
  for (const id of ["5f0c6c9be0b24d9f8c1be9ad0a2f1f0e", "5f0c6c9b", "", "5F0C6C9BE0B24D9F8C1BE9AD0A2F1F0E"])
    expect(isRecordingId(id)).toBe(served.test(id));
  expect(isRecordingId("5f0c6c9be0b24d9f8c1be9ad0a2f1f0e")).toBe(true);
});
