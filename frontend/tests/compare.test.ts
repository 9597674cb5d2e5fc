import { describe, expect, it } from "vitest";
import type { CalibrationResult, Recording, Run } from "../src/api/client";
import { differences, inSigmas, isApart, rotationBetween } from "../src/features/result/difference";
import { awayText, difference } from "../src/features/result/history";
import { listed } from "../src/features/start/standing";

const turn = (deg: number): number[][] => {
  const [c, s] = [Math.cos((deg * Math.PI) / 180), Math.sin((deg * Math.PI) / 180)];
  return [
    [c, -s, 0, 0],
    [s, c, 0, 0],
    [0, 0, 1, 0],
    [0, 0, 0, 1],
  ];
};

const result = (deg: number, x: number, dt: number): CalibrationResult =>
  ({
    T_imu_lidar: { matrix: turn(deg), translation_m: [x, 0, 0] },
    uncertainty: {
      rotation_std_deg: [0.3, 0.3, 0.3],
      translation_std_m: [0.003, 0.003, 0.003],
      time_offset_std_s: 0.0003,
    },
    time_offset_s: dt,
    provenance: { recording: { sha256: "00" } },
  }) as unknown as CalibrationResult;

describe("two runs", () => {
  // Oracle: turns about one axis by hand. Fails when the difference is taken of roll, pitch and yaw across 180 degrees.
  it("differ by the turn between them, about the lidar's axes", () => {
    expect((rotationBetween(turn(170), turn(-170))[2] * 180) / Math.PI).toBeCloseTo(20);
    expect((rotationBetween(turn(10), turn(10))[2] * 180) / Math.PI).toBeCloseTo(0);
    expect(Math.abs((rotationBetween(turn(0), turn(180))[2] * 180) / Math.PI)).toBeCloseTo(180);
  });

  // Fails when one run's sigma stands for both.
  it("are as unsure of their difference as both together", () => {
    const found = differences(result(10, 0.1, 0.004), result(11, 0.104, 0.004));
    expect(found?.find((one) => one.name === "Position x")).toMatchObject({ unit: "mm" });
    expect(found?.find((one) => one.name === "Position x")?.value).toBeCloseTo(4);
    expect(found?.find((one) => one.name === "Position x")?.sigma).toBeCloseTo(3 * Math.SQRT2);
    expect(found?.find((one) => one.name === "Turn z")?.value).toBeCloseTo(1);
    expect(differences({ ...result(0, 0, 0), T_imu_lidar: null }, result(0, 0, 0))).toBeNull();
  });
});

describe("clocks that run apart", () => {
  const at = (dt: number, atS: number, rate: number | null, std: number | null, sha256 = "00"): CalibrationResult => ({
    ...result(0, 0, dt),
    time_offset_at_s: atS,
    clock_rate_ppm: rate,
    clock_rate_ppm_std: std,
    provenance: { recording: { sha256 } } as CalibrationResult["provenance"],
  });
  const time = (a: CalibrationResult, b: CalibrationResult) => differences(a, b)?.at(-1);
  const [half, whole] = [at(0.01, 15, 21, 4), at(0.0106, 45, 20, 3)];

  // Oracle: 30 s at 20 ppm are 0.6 ms, by hand; 3 ppm unsure are 0.09 ms. Fails when offsets are subtracted as they stand; by the
  // rate that is less well known; when the rate's own sigma is left out; when it has a sign.
  it("make no difference between answers of one recording", () => {
    expect(time(half, whole)?.value).toBeCloseTo(0, 9);
    expect(time(whole, half)?.value).toBeCloseTo(0, 9);
    for (const found of [time(half, whole), time(whole, half)])
      expect(found?.sigma).toBeCloseTo(Math.hypot(0.3, 0.3, 0.09), 9);
    expect(time(at(0.01, 15, null, null), whole)?.value).toBeCloseTo(0, 9);
    expect(time(half, at(0.0106, 45, null, null))?.value).toBeCloseTo(-0.03, 9);
  });

  // Fails when another recording's offset is carried, or one of no recording that is known.
  it("say nothing of another recording", () => {
    expect(time(at(0.01, 15, 20, 3, "11"), whole)?.value).toBeCloseTo(0.6, 9);
    expect(time(at(0.01, 15, 20, 3, ""), at(0.0106, 45, 20, 3, ""))?.value).toBeCloseTo(0.6, 9);
    expect(time(at(0.01, 15, null, null), at(0.0106, 45, null, null))?.value).toBeCloseTo(0.6, 9);
  });
});

describe("a run whose result lies damaged", () => {
  // Fails when it is passed over in silence, or called the newest answer.
  it("says so", () => {
    const job = { state: "done", result: { kind: "solve", status: "calibrated" } };
    const run = { job, error: { code: "result.unreadable", text: "It lies damaged." } } as unknown as Run;
    expect(difference(run, true)).toBe("It lies damaged.");
  });
});

describe("what is called far", () => {
  // Fails when a difference of 3.0 sigmas, as it is shown, is called the same answer; when 2.9 is not.
  it("is what is seen to be", () => {
    const at = (sigmas: number) => ({ value: -sigmas * 0.2, sigma: 0.2 });
    expect([3.04, 2.96, 2.94].map((sigmas) => [inSigmas(at(sigmas)), isApart(at(sigmas))])).toEqual([
      [3, true],
      [3, true],
      [2.9, false],
    ]);
    expect(isApart({ value: 1, sigma: 0 })).toBe(false);
  });

  // Fails when a distance is told with a sign.
  it("is away by so much, whichever came first", () => {
    expect(awayText({ translation_m: 0.0012, rotation_deg: 0.01, time_offset_s: -0.00001 })).toBe(
      "the newest is 1.2 mm, 0.010°, 0.01 ms away",
    );
  });
});

describe("recordings", () => {
  const of = (name: string, size: number, at: string, verdict: Recording["verdict"]) =>
    ({ name, size_bytes: size, created_at: at, state: "ready", verdict, latest_job: null }) as unknown as Recording;
  const all = [
    of("room 10.bag", 5, "2026-01-01", "good"),
    of("room 9.bag", 9, "2026-01-02", "unusable"),
    of("car.bag", 7, "2026-01-03", "limited"),
  ];

  // Fails when only the name is searched, or when 10 comes before 9.
  it("are found by name or verdict, and sorted", () => {
    expect(listed(all, "room", "name").map((one) => one.name)).toEqual(["room 9.bag", "room 10.bag"]);
    expect(listed(all, "not usable", "newest").map((one) => one.name)).toEqual(["room 9.bag"]);
    expect(listed(all, "", "standing").map((one) => one.verdict)).toEqual(["good", "limited", "unusable"]);
    expect(listed(all, "", "largest")[0]?.size_bytes).toBe(9);
  });
});
