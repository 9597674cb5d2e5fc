import { describe, expect, it } from "vitest";
import type { Recording, StageEvent } from "../src/api/client";
import { addMessages, emptyRun } from "../src/api/jobstream";
import { longStep, stalledS } from "../src/features/jobs/timeleft";
import { determines, strength } from "../src/features/planes/determinacy";
import { planesText } from "../src/features/recording/forecast";
import { contradicted, firstStep, missedPlanes, otherUnit, toMeasure } from "../src/features/result/nextsteps";
import { toneOf } from "../src/features/result/verdict";
import { answerOf, parametersOf } from "../src/features/solve/parameters";
import { standingOf } from "../src/features/start/standing";
import { stdText, wrapped } from "../src/ui/format";

const outcome = {
  kind: "solve",
  status: "calibrated",
  verdict: "",
  euler_xyz_deg: [1, 2, -179],
  rotation_std_deg: [0.1, 0.2, 0.3],
  translation_m: [0.1, 0.2, 0.3],
  translation_std_m: [0.003, 0.002, 0.001],
  time_offset_s: 0.004,
  time_offset_std_s: 0.001,
  point_to_plane_rms_m: 0.01,
} as unknown as NonNullable<Parameters<typeof answerOf>[0]>;

describe("one truth", () => {
  // Fails when the table at the end shows the last iteration's sigmas instead of the verdict's.
  it("ends the solve's table with the outcome", () => {
    const last = parametersOf([
      { ...outcome, translation_std_m: [0.00029, 0.1, 0.1] } as never,
      ...answerOf(outcome, false),
    ]);
    expect(last.find((one) => one.key === "tx")?.sigmas.at(-1)).toBeCloseTo(3);
    expect(answerOf({ ...outcome, euler_xyz_deg: null }, false)).toEqual([]);
  });

  // Fails when an angle is shown as 181 in one place and as -179 in another.
  it("wraps angles one way", () => {
    expect([181, -180, 180, 540, -181, 0].map(wrapped)).toEqual([-179, 180, 180, 180, 179, 0]);
  });

  // Fails when green is given by the status alone.
  it("is green only for what nothing speaks against", () => {
    expect(toneOf("calibrated", [])).toBe("good");
    expect(toneOf("calibrated", ["solve.disagreement"])).toBe("warning");
    expect(toneOf("calibrated", ["planes.doubted"])).toBe("warning");
    expect(toneOf("calibrated", ["planes.unseen"])).toBe("warning");
    expect(toneOf("calibrated", ["planes.instead"])).toBe("warning");
    expect(toneOf("refused", [])).toBe("error");
  });

  // Fails when the gauge rises as the sigma grows.
  it("falls when the weakest sigma grows", () => {
    const at = (std: number) => strength({ name: "", std, unit: "m", limit: 0.02, weak: std > 0.02, text: "" });
    const lengths = [0.00001, 0.0001, 0.001, 0.01, 0.1].map(at);
    expect([...lengths].sort((a, b) => b - a)).toEqual(lengths);
    expect(strength(null)).toBe(0);
    expect(stdText(0.00063, "m")).toBe("0.63 mm");
    expect(stdText(9.13506, "m")).toBe("9.1 m");
  });

  // Fails when planes that fix all directions are green over an axis that would stay unknown.
  it("is no green where the forecast is useless", () => {
    const determinacy = { ok: true, text: "", smallest_eigenvalue: 0.3 };
    const axis = { name: "Position z", std: 1.5, unit: "m", limit: 0.02, text: "Tilt the rig." } as const;
    expect(determines({ determinacy, foreseen: { ...axis, weak: true } })).toBe(false);
    expect(determines({ determinacy, foreseen: { ...axis, weak: false } })).toBe(true);
    expect(determines({ determinacy, foreseen: null })).toBe(true);
  });

  // Fails when a sample's number of planes stands beside the number that was found; when planes are called confirmed that
  // nobody has looked at.
  it("counts planes once", () => {
    const sampled = { text: "A sample of the points shows 8 planes" } as Parameters<typeof planesText>[0];
    const found = (confirmed: boolean[]) =>
      ({
        patches: confirmed.map((one) => ({ confirmed: one })),
        determinacy: { ok: confirmed.length > 1, text: `${confirmed.length} confirmed planes, said elsewhere` },
      }) as unknown as Parameters<typeof planesText>[1];
    expect(planesText(sampled, undefined)).toBe("A sample of the points shows 8 planes");
    expect(planesText(sampled, found([true, true]))).toBe("2 planes seen; together they fix where the lidar is.");
    expect(planesText(sampled, found([true]))).toBe("1 confirmed planes, said elsewhere");
    expect(planesText(sampled, found([true, false, false]))).toBe(
      "With all 3 planes that were found; 1 is chosen now.",
    );
    expect(planesText(sampled, found([false]))).toBe("With the one plane that was found; 0 are chosen now.");
  });

  // Fails when the list says "Ready" of what the doctor calls unusable.
  it("shows the doctor's verdict in the list", () => {
    const ready = {
      state: "ready",
      latest_job: { kind: "planes", state: "done", result: null },
    } as unknown as Recording;
    expect(standingOf({ ...ready, verdict: "unusable" })).toEqual({
      tone: "error",
      text: "Not usable as it is",
      screen: "recording",
    });
    expect(standingOf({ ...ready, verdict: "good" }).tone).toBe("good");
  });
});

describe("progress", () => {
  const stage = (fraction: number): StageEvent => ({ event: "stage", stage: "track", fraction, text: "", kept: false });

  // Fails when a stage that is gone through again starts from nought.
  it("never goes back", () => {
    const run = addMessages(emptyRun, [stage(0.8), stage(0.1)]);
    expect(run.stages[0]?.fraction).toBe(0.8);
  });

  // Fails when a long step is called a stall, or when a run that says nothing for minutes is none.
  it("says that a step is long, and that it hangs", () => {
    const at = (ms: number) => [longStep(0, ms), stalledS(0, ms)];
    expect([longStep(null, 1e6), stalledS(null, 1e6)]).toEqual([null, null]);
    expect(at(10_000)).toEqual([null, null]);
    expect(at(35_000)).toEqual([35, null]);
    expect(at(200_000)).toEqual([200, 200]);
  });
});

describe("the next step of a refusal", () => {
  const recording = {
    report: { imu: { gyroscope_unit: "rad_s" } },
    read_settings: { gyroscope_unit: null },
  } as unknown as Recording;

  // Fails when the unit that is in use already is offered.
  it("offers the other unit, and only where the unit is in doubt", () => {
    expect(otherUnit(recording, ["the gyroscope turns 57 times as fast as the lidar"])?.change).toEqual({
      gyroscope_unit: "deg_s",
    });
    expect(otherUnit(recording, ["the lidar stood still"])).toBeNull();
  });

  // Fails when what is said of every recording in g is taken for a doubt; when two reasons together make one; when a bias
  // that wanders "29 times as fast" is taken for a gyroscope in degrees, and that is the first thing to do.
  it("leaves a unit alone that nothing speaks against", () => {
    const inG = "Accelerations on /imu are in g: at rest their norm is 1.00.";
    expect(otherUnit(recording, [inG, "the chosen planes do not determine the motion"])).toBeNull();
    expect(otherUnit(recording, [inG, "the turns hang together (in units of 1 deg, 10 mm, 1 ms)"])).toBeNull();
    expect(otherUnit(recording, [inG, "the unit of the ranges is in doubt"])).toBeNull();
    const wanders = "The gyroscope's bias seems to drift 29 times as fast as that of such sensors once they are warm";
    expect(otherUnit(recording, [inG, wanders])).toBeNull();
    const gravity = "the best answer needs gravity to be 7.50 m/s²; the IMU's units or the planes are probably wrong";
    expect(otherUnit(recording, [gravity])?.change).toEqual({ accelerometer_unit: "g" });
    const neither =
      "When quietest the accelerations on /imu have norm 3.10, which is gravity neither in m/s² nor in g; m/s² is assumed.";
    expect(otherUnit(recording, [neither])?.change).toEqual({ accelerometer_unit: "g" });
  });

  const unit = otherUnit(recording, ["the gyroscope turns 57 times as fast as the lidar"]);
  // Fails when every refusal leads back to the planes; when a weak answer does not ask for another motion.
  it.each([
    ["refused", ["imu.gyroscope_unit"], unit, "unit"],
    ["refused", ["motion.none"], null, "record"],
    ["refused", ["planes.lost"], null, "planes"],
    ["refused", ["imu.axis_signs"], null, "reading"],
    ["refused", ["points.straightened"], null, "reading"],
    ["weak", ["solve.weak"], null, "record"],
    ["weak", ["prior.contradicted", "solve.disagreement"], null, "settings"],
    ["refused", ["prior.contradicted"], null, "settings"],
    ["calibrated", ["solve.disagreement"], null, "planes"],
    ["calibrated", ["map.none"], null, null],
    ["calibrated", ["planes.bent", "planes.doubted"], null, null],
  ] as const)("of %s with %j puts first what helps", (status, codes, doubted, step) => {
    expect(firstStep(status, codes, doubted)).toBe(step);
  });

  // Seen: with one plane kept of six, "Record again" came first and nothing said that five were dropped. Fails when planes are asked for
  // where those that counted face three ways, or where none that was found would help.
  it("of a weak answer with planes that were left out puts these first", () => {
    const [x, y, z] = [{ normal: [1, 0, 0] }, { normal: [0, 1, 0] }, { normal: [0, 0.1, 0.995] }] as const;
    const all = [x, y, z, x];
    expect(missedPlanes([x], all)).toBe(3);
    expect(missedPlanes([x, y], all)).toBe(2);
    expect(missedPlanes([x, y, z], all)).toBe(0);
    expect(missedPlanes([x], [x, y, x])).toBe(0);
    expect(firstStep("weak", [], null, 3)).toBe("planes");
    expect(firstStep("weak", [], null, 0)).toBe("record");
    expect(firstStep("calibrated", [], null, 3)).toBeNull();
  });

  // Fails when who gave two numbers is sent to the one that is right; when nobody is sent anywhere where the words are others.
  it("of a number that was given leads to that number", () => {
    const said = (what: string) => [`what was given for the ${what} contradicts the recording`];
    expect(contradicted(said("translation along the IMU's z axis"), ["tx", "tz"])).toBe("tz");
    expect(contradicted(said("rotation about the lidar's y axis"), ["tx", "ry"])).toBe("ry");
    expect(contradicted(said("time offset"), ["tx", "dt"])).toBe("dt");
    expect(contradicted(["something else"], ["ty"])).toBe("ty");
    expect(contradicted(said("time offset"), [])).toBeNull();
  });

  // Fails when the tape measure is asked for along the axis that is known best, of an answer that is not weak, or where only the
  // turns are weak.
  it("asks for the position that is known least", () => {
    const weak = (...translation_std_m: number[]) => ({ status: "weak", uncertainty: { translation_std_m } }) as never;
    expect(toMeasure(weak(1.3, 3.9, 9.1), 0.02)).toBe("tz");
    expect(toMeasure(weak(0.03, 0.001, 0.001), 0.02)).toBe("tx");
    expect(toMeasure(weak(0.003, 0.001, 0.002), 0.02)).toBeNull();
    const calibrated = { status: "calibrated", uncertainty: { translation_std_m: [0.1, 0.1, 0.1] } } as never;
    expect(toMeasure(calibrated, 0.02)).toBeNull();
    expect(toMeasure({ status: "refused", uncertainty: null }, 0.02)).toBeNull();
  });
});
