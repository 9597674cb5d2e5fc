import { describe, expect, it } from "vitest";
import type { Job } from "../src/api/client";
import { asking, draftOf, problemsOf, settingsOf } from "../src/features/solve/draft";
import { matrixOf } from "../src/features/solve/guess";
import { gravityAt, latitudeOf, priorOf, priorText } from "../src/features/solve/priors";
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

/** Of a solve that is told nothing. */
const told = before;
/** What the tests below are not about. */
const draftWith = (settings: Job["settings"]) => draftOf(settings, usual, told);

describe("what a solve is told", () => {
  // Fails when a number of the page's own is taken for the server's: 12 rounds, 100 points, 45 degrees, 0.005 m/s².
  it("takes for usual what the server does", () => {
    const draft = draftWith({ ...before, max_rounds: 14 });
    expect([draft.rounds, draftWith({ ...before, max_rounds: 12 }).rounds]).toEqual(["", "12"]);
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

  // Fails when who was sent here to give a number finds no field for it; when what was given before is asked for twice.
  it("has a row for the axis that somebody is to give", () => {
    const row = { axis: "tz", value: "", sigma: "" };
    expect(asking(draftWith(before), "tz").priors).toEqual([row]);
    expect(problemsOf(asking(draftWith(before), "tz"), usual, {}).at(0)?.field).toBe("prior 0 value");
    const given = asking(draftWith(before), "tz");
    expect(asking(given, "tz")).toBe(given);
    expect(asking(draftWith(before), "nonsense").priors).toEqual([]);
    expect(asking(draftWith(before), null).priors).toEqual([]);
  });

  // Fails when an unfinished number is sent as the default, or blocks that were named one by one are lost.
  it("sends what was chosen, and nothing while a number is unfinished", () => {
    const draft = draftWith(before);
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
    expect(settingsOf(draftWith(named), named, usual)).toMatchObject({
      intrinsics: ["clock_rate"],
      lidar: "a preset",
    });
    expect(settingsOf({ ...draftWith(named), intrinsics: "auto" }, named, usual)).toHaveProperty("intrinsics", "auto");
  });

  // Fails when a field is not named, or another one than the first; when a solve may start beside a problem, or may not without.
  it("names the field that stands in the way", () => {
    const draft = draftWith(before);
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
    const draft = draftWith({ ...before, lidar: "VLP-16", random_seed: 7, max_rounds: 20 });
    expect([draft.lidar, draft.seed, draft.rounds]).toEqual(["VLP-16", "7", "20"]);
    const sent = settingsOf({ ...draft, lidar: "", seed: "", rounds: "" }, before, usual);
    expect([sent?.lidar, sent?.random_seed, sent?.max_rounds]).toEqual([null, 0, 14]);
    expect(settingsOf({ ...draft, rounds: "0" }, before, usual)).toBeNull();
    expect(settingsOf({ ...draft, seed: "1.5" }, before, usual)).toBeNull();
  });
});

/** Numbers that are the same in every run of the tests: mulberry32. */
function draws(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), 1 | state);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
}

/** Settings as a command line, a script or a page may have sent them. */
function anySettings(draw: () => number): Job["settings"] {
  const one = <T>(...choices: T[]): T => choices[Math.floor(draw() * choices.length)] as T;
  return {
    method: one("full", "paper"),
    points_per_plane_per_scan: one(null, 1, usual.paper_points_per_plane_per_scan, 37),
    field_of_view_deg: one(null, 180, usual.paper_field_of_view_deg, draw() * 180),
    gravity: one(
      told.gravity,
      { magnitude_m_s2: 9.80665, std_m_s2: 0 },
      { magnitude_m_s2: gravityAt(draw() * 180 - 90), std_m_s2: usual.latitude_gravity_std_m_s2 },
      { magnitude_m_s2: 9.9, std_m_s2: usual.latitude_gravity_std_m_s2 },
      { magnitude_m_s2: 9 + draw(), std_m_s2: draw() },
      { magnitude_m_s2: told.gravity.magnitude_m_s2, std_m_s2: 0.01 },
      { magnitude_m_s2: 1.62, std_m_s2: 0 },
    ),
    imu_noise: one<Job["settings"]["imu_noise"]>(null, "mti-3", {
      gyroscope_noise_density_rad_s_sqrt_hz: draw(),
      accelerometer_noise_density_m_s2_sqrt_hz: draw(),
      gyroscope_random_walk: draw(),
      accelerometer_random_walk: draw(),
      range_std_m: one(null, draw()),
    }),
    estimate_time_offset: one(true, false),
    estimate_planes: one(true, false),
    bias_model: one("constant", "random-walk"),
    imu_sampling: one("detect", "as-stamped", "even"),
    lidar_sampling: one("detect", "as-stamped"),
    cloud: one("detect", "as-sent"),
    intrinsics: one<Job["settings"]["intrinsics"]>("auto", "consider", "off", ["clock_rate", "incidence"]),
    lidar: one(null, "ouster-os"),
    priors: one([], [{ axis: "tz", value: draw() - 0.5, std: draw() }], [{ axis: "rx", value: draw(), std: 1e-9 }]),
    random_seed: one(0, 7),
    max_rounds: one(usual.max_rounds, 3),
    crispness: one(true, false),
    excluded_spans_s: one([], [[draw(), 2 + draw()]]),
  };
}

describe("the choices of a run", () => {
  // Mutations, each of which told another run than the one before: gravity by latitude as free, its magnitude anew from the
  // latitude's digits, any other as exact; densities as none; a paper run's own limits as the usual ones, and "all" as those; a
  // prior anew from the digits that are read; crispness left out.
  it("are those of the next one where nobody changes them, to the last digit", () => {
    const draw = draws(1);
    for (let run = 0; run < 2000; run += 1) {
      const settings = anySettings(draw);
      const draft = draftOf(settings, usual, told);
      expect(problemsOf(draft, usual, {})).toEqual([]);
      const sent = settingsOf(draft, settings, usual);
      expect({ gravity: told.gravity, ...sent }).toEqual(settings);
      expect(draftOf({ ...settings, ...sent }, usual, told)).toEqual(draft);
    }
  });

  // Mutations: the number of the run before sent beside a field that was typed anew; "all" for no number in a full run.
  it("give way to what is typed", () => {
    const settings: Job["settings"] = {
      ...before,
      method: "paper",
      points_per_plane_per_scan: null,
      field_of_view_deg: 60,
      gravity: { magnitude_m_s2: gravityAt(48), std_m_s2: usual.latitude_gravity_std_m_s2 },
    };
    const draft = draftWith(settings);
    expect([draft.points, draft.fieldDeg, draft.gravity, draft.gravityNumber]).toEqual(["all", "60", "latitude", "48"]);
    const sent = settingsOf({ ...draft, points: "", fieldDeg: "All", gravityNumber: "49" }, settings, usual);
    expect([sent?.points_per_plane_per_scan, sent?.field_of_view_deg]).toEqual([90, null]);
    expect(sent?.gravity?.magnitude_m_s2).toBe(gravityAt(49));
    expect(settingsOf({ ...draft, method: "full" }, settings, usual)?.points_per_plane_per_scan).toBeNull();
  });

  // Oracle: the formula itself, turned round.
  it("know a latitude by its gravity", () => {
    expect([0, 12.5, 48.1, 90].map((deg) => latitudeOf(gravityAt(deg)))).toEqual([0, 12.5, 48.1, 90]);
    expect([9.78, 9.84].map(latitudeOf)).toEqual([null, null]);
  });
});
