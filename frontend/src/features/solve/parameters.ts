import type { IterationEvent, SolveOutcome } from "../../api/client";
import { unitOf, type Axis, type SpaceAxis } from "../../ui/axes";
import { anglesText } from "../../ui/format";
import { turnDeg } from "./turns";

export interface Parameter {
  name: string;
  key: Axis;
  unit: ReturnType<typeof unitOf>;
  axis: SpaceAxis | "t";
  values: number[];
  /** Null where it was held. */
  sigmas: (number | null)[];
}

interface Answer {
  euler_xyz_deg: readonly number[];
  rotation_std_deg: readonly (number | null)[];
  translation_m: readonly number[];
  translation_std_m: readonly (number | null)[];
  time_offset_s: number;
  time_offset_std_s: number | null;
}

/** As the answer is told, and in its order: as a pose, its turn by how sure it is about each of the lidar's axes. */
const names: Readonly<Record<Axis, string>> = {
  tx: "Position x",
  ty: "Position y",
  tz: "Position z",
  rx: "About lidar x",
  ry: "About lidar y",
  rz: "About lidar z",
  dt: "Time offset",
};
const told = Object.keys(names) as readonly Axis[];

/** An axis's value and standard deviation in one answer, in the unit people read: of a turn, how far it is from the last one. */
function shownOf(axis: Axis, answer: Answer, last: Answer): readonly [number, number | null] {
  const scaled = (std: number | null | undefined, factor: number) => (std === null ? null : (std ?? NaN) * factor);
  if (axis === "dt") return [answer.time_offset_s * 1000, scaled(answer.time_offset_std_s, 1000)];
  const place = "xyz".indexOf(axis.slice(1));
  const [values, stds, factor] = axis.startsWith("r")
    ? [turnDeg(last.euler_xyz_deg, answer.euler_xyz_deg), answer.rotation_std_deg, 1]
    : [answer.translation_m, answer.translation_std_m, 1000];
  return [(values[place] ?? NaN) * factor, scaled(stds[place], factor)];
}

/** The seven numbers of the calibration over the iterations, in the units people read.
 *
 *  Standard deviations of the rotation are of turns about the lidar's axes, so such turns are what they stand beside: roll, pitch and
 *  yaw are turns about other axes once the lidar lies on its side.
 */
export function parametersOf(answers: readonly Answer[]): Parameter[] {
  const last = answers.at(-1);
  return told.map((key): Parameter => {
    const shown = last === undefined ? [] : answers.map((answer) => shownOf(key, answer, last));
    return {
      name: names[key],
      key,
      unit: unitOf(key),
      axis: key === "dt" ? "t" : (key.slice(1) as SpaceAxis),
      values: shown.map(([value]) => value),
      sigmas: shown.map(([, sigma]) => sigma),
    };
  });
}

/** Roll, pitch and yaw of the last answer [°]; null before the first. */
export function anglesOf(answers: readonly Answer[]): string[] | null {
  const last = answers.at(-1);
  return last === undefined ? null : anglesText(last.euler_xyz_deg, last.rotation_std_deg);
}

/** The run's outcome as the last of its answers: the sigmas that the verdict has, not those of the last iteration.
 *
 *  held: whether the time offset was not estimated, whose sigma is nobody's finding then.
 */
export function answerOf(outcome: SolveOutcome | null, held: boolean): Answer[] {
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
  const answer = { euler_xyz_deg, rotation_std_deg, translation_m, translation_std_m, time_offset_s };
  return [{ ...answer, time_offset_std_s: held ? null : time_offset_std_s }];
}

/** Cost of each iteration, for a logarithmic axis: what is not positive is left out. */
export function costs(iterations: readonly IterationEvent[]): (number | null)[] {
  return iterations.map((iteration) => (iteration.cost > 0 ? iteration.cost : null));
}
