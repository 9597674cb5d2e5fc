import { describe, expect, it } from "vitest";
import type { Job } from "../src/api/client";
import { draftOf, problemsOf, settingsOf } from "../src/features/solve/draft";
import { matrixOf } from "../src/features/solve/guess";
import { gravityAt, priorOf, priorText } from "../src/features/solve/priors";
import { usual } from "./usual";

const before = {
  method: "full",
  points_per_plane_per_scan: null,
  field_of_view_deg: null,
  gravity: { magnitude_m_s2: 9.807, std_m_s2: 0.02 },
  imu_noise: null,
  estimate_time_offset: true,
  estimate_planes: true,
  bias_model: "random-walk",
  imu_sampling: "detect",
  priors: [],
  random_seed: 0,
  max_rounds: 12,
  excluded_spans_s: [[1, 2]],
  intrinsics: "auto",
  lidar: null,
} as unknown as Job["settings"];

describe("what a solve is told", () => {
  // Fails when a number of the page's own is taken for the server's: 12 rounds, 100 points, 45 degrees, 0.005 m/s².
  it("takes for usual what the server does", () => {
    const draft = draftOf({ ...before, max_rounds: 14 }, usual);
    expect([draft.rounds, draftOf({ ...before, max_rounds: 12 }, usual).rounds]).toEqual(["", "12"]);
    expect(settingsOf({ ...draft, method: "paper" }, before, usual)).toMatchObject({
      points_per_plane_per_scan: 90,
      field_of_view_deg: 50,
      max_rounds: 14,
    });
    expect(settingsOf({ ...draft, gravity: "latitude", gravityNumber: "0" }, before, usual)?.gravity?.std_m_s2).toBe(
      0.004,
    );
  });

  // Fails when degrees or millimetres are sent as they are typed.
  it("takes priors in the units that people read", () => {
    expect(priorOf({ axis: "tz", value: "310", sigma: "5" })).toEqual({ axis: "tz", value: 0.31, std: 0.005 });
    expect(priorOf({ axis: "dt", value: "−4,5", sigma: "1" })).toEqual({ axis: "dt", value: -0.0045, std: 0.001 });
    expect(priorOf({ axis: "rx", value: "180", sigma: "0.5" })?.value).toBeCloseTo(Math.PI);
    expect(priorOf({ axis: "rx", value: "0", sigma: "0" })).toBeNull();
    expect(priorOf({ axis: "rx", value: "", sigma: "1" })).toBeNull();
    expect(priorText({ axis: "rx", value: Math.PI / 2, std: 0.01 })).toEqual({
      axis: "rx",
      value: "90",
      sigma: "0.572958",
    });
  });

  // Fails when an unfinished number is sent as the default, or blocks that were named one by one are lost.
  it("sends what was chosen, and nothing while a number is unfinished", () => {
    const draft = draftOf(before, usual);
    expect(settingsOf(draft, before, usual)).toMatchObject({
      method: "full",
      points_per_plane_per_scan: null,
      excluded_spans_s: [[1, 2]],
      priors: [],
    });
    expect(settingsOf(draft, before, usual)).toHaveProperty("intrinsics", "auto");
    expect(settingsOf({ ...draft, method: "paper" }, before, usual)).toMatchObject({
      points_per_plane_per_scan: 90,
      field_of_view_deg: 50,
    });
    expect(settingsOf({ ...draft, points: "2.5" }, before, usual)).toBeNull();
    expect(settingsOf({ ...draft, gravity: "latitude", gravityNumber: "" }, before, usual)).toBeNull();
    expect(settingsOf({ ...draft, gravity: "exact", gravityNumber: "9.81" }, before, usual)?.gravity).toEqual({
      magnitude_m_s2: 9.81,
      std_m_s2: 0,
    });
    expect(settingsOf({ ...draft, intrinsics: "off" }, before, usual)).toHaveProperty("intrinsics", "off");
    const named: Job["settings"] = { ...before, intrinsics: ["clock_rate"], lidar: "a preset" };
    expect(settingsOf(draftOf(named, usual), named, usual)).toMatchObject({
      intrinsics: ["clock_rate"],
      lidar: "a preset",
    });
    expect(settingsOf({ ...draftOf(named, usual), intrinsics: "auto" }, named, usual)).toHaveProperty(
      "intrinsics",
      "auto",
    );
  });

  // Fails when a field is not named, or another one than the first; when a solve may start beside a problem, or may not without.
  it("names the field that stands in the way", () => {
    const draft = draftOf(before, usual);
    const prior = { axis: "tz", value: "310", sigma: "" } as const;
    const first = (part: Partial<typeof draft>) => {
      const tried = { ...draft, ...part };
      const problem = problemsOf(tried, usual, { tz: "Position z" }).at(0);
      expect(settingsOf(tried, before, usual) === null).toBe(problem !== undefined);
      return problem;
    };
    expect(first({})).toBeUndefined();
    expect(first({ priors: [prior], seed: "x" })).toEqual({
      field: "prior 0 sigma",
      text: "Position z: its standard deviation, a number above 0 mm, is missing.",
    });
    expect(first({ priors: [{ ...prior, value: "", sigma: "5" }] })?.field).toBe("prior 0 value");
    expect(first({ gravity: "latitude" })?.text).toMatch("Latitude");
    expect(first({ points: "2.5" })?.field).toBe("points");
    expect(first({ fieldDeg: "200" })?.field).toBe("field");
    expect(first({ rounds: "0" })?.field).toBe("rounds");
    expect(first({ seed: "-1" })?.field).toBe("seed");
  });

  // Oracle: the formula's values at the equator and the poles.
  it("knows gravity by latitude", () => {
    expect(gravityAt(0)).toBeCloseTo(9.7803, 4);
    expect(gravityAt(-90)).toBeCloseTo(9.8322, 4);
  });

  // Oracle: a quarter turn about z by hand. Fails when the matrix is transposed.
  it("turns a quaternion into a matrix", () => {
    const matrix = matrixOf({ translation_m: [1, 2, 3], quaternion_xyzw: [0, 0, Math.SQRT1_2, Math.SQRT1_2] });
    [
      [0, -1, 0, 1],
      [1, 0, 0, 2],
      [0, 0, 1, 3],
      [0, 0, 0, 1],
    ].forEach((row, i) => row.forEach((value, j) => expect(matrix[i]?.[j]).toBeCloseTo(value)));
  });
});

describe("what only experts need", () => {
  // Mutations: an empty field sent as nought; the preset of the run before kept when "as recognised" is chosen.
  it("sends a lidar, a seed and rounds as chosen, and what is usual where nothing is", () => {
    const draft = draftOf({ ...before, lidar: "VLP-16", random_seed: 7, max_rounds: 20 }, usual);
    expect([draft.lidar, draft.seed, draft.rounds]).toEqual(["VLP-16", "7", "20"]);
    const sent = settingsOf({ ...draft, lidar: "", seed: "", rounds: "" }, before, usual);
    expect([sent?.lidar, sent?.random_seed, sent?.max_rounds]).toEqual([null, 0, 14]);
    expect(settingsOf({ ...draft, rounds: "0" }, before, usual)).toBeNull();
    expect(settingsOf({ ...draft, seed: "1.5" }, before, usual)).toBeNull();
  });
});
