import type { IterationEvent, SolveOutcome } from "../../api/client";

export interface Parameter {
  name: string;
  /** What it is called in the contract's covariance order. */
  key: "rx" | "ry" | "rz" | "tx" | "ty" | "tz" | "dt";
  unit: "°" | "mm" | "ms";
  axis: "x" | "y" | "z" | "t";
  values: number[];
  sigmas: number[];
}

interface Answer {
  euler_xyz_deg: readonly number[];
  rotation_std_deg: readonly number[];
  translation_m: readonly number[];
  translation_std_m: readonly number[];
  time_offset_s: number;
  time_offset_std_s: number;
}

const rotations = [
  ["Roll", "rx", "x"],
  ["Pitch", "ry", "y"],
  ["Yaw", "rz", "z"],
] as const;
const translations = [
  ["Position x", "tx", "x"],
  ["Position y", "ty", "y"],
  ["Position z", "tz", "z"],
] as const;

/** The seven numbers of the calibration over the iterations, in the units people read.
 *
 *  A roll, pitch or yaw carries the standard deviation of the turn about the lidar's axis of the same letter: what it
 *  shows is how fast the answer settles; the result has the covariance itself.
 */
export function parametersOf(answers: readonly Answer[]): Parameter[] {
  const pick = (of: (answer: Answer) => number | undefined) => answers.map((answer) => of(answer) ?? NaN);
  return [
    ...rotations.map(([name, key, axis], i): Parameter => ({
      name,
      key,
      axis,
      unit: "°",
      values: unwrap(pick((answer) => answer.euler_xyz_deg[i])),
      sigmas: pick((answer) => answer.rotation_std_deg[i]),
    })),
    ...translations.map(([name, key, axis], i): Parameter => ({
      name,
      key,
      axis,
      unit: "mm",
      values: pick((answer) => (answer.translation_m[i] ?? NaN) * 1000),
      sigmas: pick((answer) => (answer.translation_std_m[i] ?? NaN) * 1000),
    })),
    {
      name: "Time offset",
      key: "dt",
      axis: "t",
      unit: "ms",
      values: pick((answer) => answer.time_offset_s * 1000),
      sigmas: pick((answer) => answer.time_offset_std_s * 1000),
    },
  ];
}

/** The run's outcome as the last of its answers: the sigmas that the verdict has, not those of the last iteration. */
export function answerOf(outcome: SolveOutcome | null): Answer[] {
  if (outcome === null) return [];
  const { euler_xyz_deg, rotation_std_deg, translation_m, translation_std_m, time_offset_s, time_offset_std_s } =
    outcome;
  if (
    euler_xyz_deg === null ||
    rotation_std_deg === null ||
    translation_m === null ||
    translation_std_m === null ||
    time_offset_s === null ||
    time_offset_std_s === null
  ) {
    return [];
  }
  return [{ euler_xyz_deg, rotation_std_deg, translation_m, translation_std_m, time_offset_s, time_offset_std_s }];
}

/** Angles that cross +-180 degrees, drawn without the jump. */
export function unwrap(degrees: readonly number[]): number[] {
  let turns = 0;
  return degrees.map((value, i) => {
    const before = degrees[i - 1];
    if (before !== undefined && value - before > 180) turns -= 360;
    if (before !== undefined && value - before < -180) turns += 360;
    return value + turns;
  });
}

/** Cost of each iteration, for a logarithmic axis: what is not positive is left out. */
export function costs(iterations: readonly IterationEvent[]): (number | null)[] {
  return iterations.map((iteration) => (iteration.cost > 0 ? iteration.cost : null));
}
