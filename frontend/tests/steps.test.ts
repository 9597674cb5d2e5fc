import { describe, expect, it } from "vitest";
import type { Planes, Recording, Run } from "../src/api/client";
import { whyNothing } from "../src/features/inspect/screen";
import { lookOf } from "../src/features/workspace/seen";
import { stepsOf } from "../src/features/workspace/state";

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
