import { describe, expect, it } from "vitest";
import type { CalibrationResult, Recording } from "../src/api/client";
import { differences, inSigmas, isApart, rotationBetween } from "../src/features/result/difference";
import { awayText } from "../src/features/result/history";
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
