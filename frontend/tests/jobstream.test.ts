import { describe, expect, it } from "vitest";
import type { IterationEvent, Job, JobMessage, StageEvent } from "../src/api/client";
import { addMessages, emptyRun } from "../src/api/jobstream";
import { parametersOf } from "../src/features/solve/parameters";
import {
  promised,
  secondsLeft,
  stagesOf,
  stagesOfSolve,
  stagesShown,
  stageState,
  standingOf,
  wholeFraction,
} from "../src/features/jobs/timeleft";

const stage = (name: StageEvent["stage"], fraction: number): StageEvent => ({
  event: "stage",
  stage: name,
  fraction,
  text: "",
  kept: false,
});
const iteration = (round: number, number: number): IterationEvent => ({
  event: "iteration",
  iteration: number,
  round,
  cost: 100 / number,
  matrix: [],
  translation_m: [0.1, 0.2, 0.3],
  euler_xyz_deg: [1, 2, number % 2 === 0 ? -179.9 : 179.9],
  time_offset_s: 0.004,
  rotation_std_deg: [0.1, 0.2, 0.3],
  translation_std_m: [0.01, 0.02, 0.03],
  time_offset_std_s: 0.001,
  planes: [],
  sweeps: [],
});

describe("a run from its messages", () => {
  const story: JobMessage[] = [
    stage("track", 0.5),
    stage("track", 1),
    stage("initialise", 0),
    stage("initialise", 1),
    stage("solve", 0.2),
    iteration(1, 1),
    stage("solve", 0.1),
    stage("solve", 0.6),
    iteration(2, 2),
    stage("deskew", 0),
  ];

  // Fails when a fraction that falls takes back what was done.
  it("only ever gets nearer to its end", () => {
    let run = emptyRun;
    let last = 0;
    for (const message of story) {
      run = addMessages(run, [message]);
      const fraction = wholeFraction(run.stages, stagesOfSolve);
      expect(fraction).toBeGreaterThanOrEqual(last);
      expect(fraction).toBeLessThanOrEqual(1);
      last = fraction;
    }
    expect(run.stages.map((one) => one.stage)).toEqual(["track", "initialise", "solve", "deskew"]);
  });

  // Fails when messages that come one by one are counted differently from those that come at once (a reload).
  it("is the same whether watched or reloaded", () => {
    const watched = story.reduce((run, message) => addMessages(run, [message]), emptyRun);
    expect(addMessages(emptyRun, story)).toEqual(watched);
  });

  // Fails when time left is shown from the first second.
  it("says nothing of the time left while it is too early", () => {
    expect(secondsLeft(0.01, 30)).toBeNull();
    expect(secondsLeft(0.15, 30)).toBeNull();
    expect(secondsLeft(0.25, 10)).toBeCloseTo(30, 9);
  });

  // Fails when the time left rises while the bar stands still; when a promise that was broken is made again, or kept back for ever.
  it("never says that more time is left than it has said", () => {
    expect(promised(null, 30)).toBe(30);
    expect(promised(30, 12)).toBe(12);
    expect(promised(12, 15)).toBe(12);
    expect(promised(12, 40)).toBeNull();
    expect(promised(12, null)).toBeNull();
    expect(promised(12, 11)).toBe(11);
  });
});

describe("a run that ended", () => {
  const ended = (state: Job["state"]) => ({ state, result: null }) as Job;
  const begun = { stage: "track" as const, fraction: 0.4, text: "", kept: false };

  // Fails when whatever has ended is called solved.
  it("is called solved only when it was", () => {
    expect(standingOf(ended("done"))).toBe("Solved");
    expect(standingOf(ended("cancelled"))).toBe("Cancelled");
    expect(standingOf(ended("interrupted"))).toBe("Interrupted");
    expect(standingOf(ended("failed"))).not.toBe("Solved");
    expect(standingOf(null)).toBe("Solve");
  });

  // Fails when the stage in which it was stopped gets a tick.
  it("ticks off no stage in which it was stopped", () => {
    expect(stageState(begun, begun, ended("cancelled"))).toBe("stopped");
    expect(stageState(begun, begun, ended("running"))).toBe("active");
    expect(stageState(begun, begun, ended("done"))).toBe("done");
    expect(stageState(undefined, begun, ended("cancelled"))).toBe("waiting");
  });
});

describe("parameters", () => {
  // Fails when metres are shown as millimetres, or the offset's sigma as the value.
  it("come in the units people read, in the answer's order", () => {
    const rows = parametersOf([iteration(1, 1)]);
    expect(rows.map((row) => row.key)).toEqual(["tx", "ty", "tz", "rx", "ry", "rz", "dt"]);
    expect(rows[0]?.values).toEqual([100]);
    expect(rows[6]?.values).toEqual([4]);
    expect(rows[6]?.sigmas).toEqual([1]);
  });
});

describe("the stages of a run", () => {
  const seen = (stage: "planes" | "track" | "initialise", fraction: number) => ({
    stage,
    fraction,
    text: "",
    kept: false,
  });

  // Fails when a stage that was passed over stays open for ever, and when one that is still ahead is left out.
  it("leaves out what an earlier run made", () => {
    expect(stagesOf([], ["read", "planes", "track"])).toEqual(["read", "planes", "track"]);
    expect(stagesOf([seen("planes", 1)], ["read", "planes", "track"])).toEqual(["planes", "track"]);
    expect(stagesOf([seen("track", 1)], stagesOfSolve)).toEqual(["track", "initialise", "solve", "deskew"]);
  });

  // Fails with a stage that nobody expected put at the end, below those that come after it.
  it("are shown in the order in which they come", () => {
    const shown = stagesShown([seen("planes", 1), seen("track", 0.5)], stagesOfSolve);
    expect(shown).toEqual(["planes", "track", "initialise", "solve", "deskew"]);
  });

  // Fails when a stage comes to a list in which it was not from the beginning: "Find planes" of a solve.
  it("are known beforehand", () => {
    const all = stagesShown([], stagesOfSolve);
    const told = ["read", "planes", "track", "initialise", "solve", "deskew"] as const;
    told.forEach((_, i) => {
      const so_far = told.slice(0, i + 1).map((stage) => ({ stage, fraction: 1, text: "", kept: false }));
      expect(stagesShown(so_far, stagesOfSolve)).toEqual(all);
    });
  });

  // Fails when what was kept counts as work done, so that a second solve seems half done as it begins; when it leaves the list.
  it("are shown, and are no work, where an earlier run has made them", () => {
    const kept = (["read", "planes", "track"] as const).map((stage) => ({ stage, fraction: 1, text: "", kept: true }));
    expect(stagesShown(kept, stagesOfSolve)).toEqual([...stagesOfSolve]);
    expect(wholeFraction(kept, stagesOfSolve)).toBe(0);
    expect(wholeFraction(kept.slice(0, 1), ["read"])).toBe(0);
    const solving = [...kept, { stage: "solve" as const, fraction: 0.5, text: "", kept: false }];
    expect(wholeFraction(solving, ["read", "planes", "track", "solve"])).toBeCloseTo(0.5, 9);
  });

  // Fails when a stage that said its last word half way is half done for ever.
  it("counts as done what another stage has come after", () => {
    const half = { stage: "planes" as const, fraction: 0.5, text: "", kept: false };
    expect(wholeFraction([half, seen("initialise", 1)], ["planes", "initialise"])).toBe(1);
    expect(wholeFraction([half], ["planes", "initialise"])).toBeLessThan(0.5);
  });

  // Fails when the time that it would have taken is still to come.
  it("counts only what is there to be done", () => {
    expect(wholeFraction([seen("initialise", 1)], ["track", "initialise"])).toBe(1);
  });

  // Fails when the convergence of a lost worker goes on in that of the one that begins anew, or its sentence is dropped.
  it("begins anew where a worker was lost", () => {
    const moved = { event: "log", level: "warning", code: "job.moved", text: "It is run again." } as const;
    const run = addMessages(emptyRun, [stage("solve", 0.9), iteration(1, 7), moved, stage("solve", 0.1)]);
    expect(run.iterations).toEqual([]);
    expect(run.stages.map((one) => one.fraction)).toEqual([0.1]);
    expect(run.logs).toEqual([moved]);
  });
});
