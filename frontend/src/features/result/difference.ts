import type { CalibrationResult } from "../../api/client";
import { xyz } from "../../ui/axes";
import { wrapped } from "../../ui/format";

export interface Difference {
  name: string;
  unit: "°" | "mm" | "ms";
  value: number;
  /** Of the difference, as if both runs had data of their own. */
  sigma: number;
}

/** An answer this many sigmas from another is not the same answer. */
export const apart = 3;

/** How many sigmas a difference is, to the tenth that is shown: what is called far has to be seen to be. */
export function inSigmas({ value, sigma }: Pick<Difference, "value" | "sigma">): number {
  return sigma > 0 ? Math.round((10 * Math.abs(value)) / sigma) / 10 : 0;
}

export function isApart(difference: Pick<Difference, "value" | "sigma">): boolean {
  return inSigmas(difference) >= apart;
}

type Matrix = readonly (readonly number[])[];

/** The rotation vector [rad] that takes the one rotation to the other, about the lidar's axes: log(A^T B). */
export function rotationBetween(a: Matrix, b: Matrix): [number, number, number] {
  const at = (m: Matrix, i: number, j: number) => m[i]?.[j] ?? 0;
  const r = [0, 1, 2].map((i) =>
    [0, 1, 2].map((j) => [0, 1, 2].reduce((sum, k) => sum + at(a, k, i) * at(b, k, j), 0)),
  );
  const skew: [number, number, number] = [
    at(r, 2, 1) - at(r, 1, 2),
    at(r, 0, 2) - at(r, 2, 0),
    at(r, 1, 0) - at(r, 0, 1),
  ];
  const sine = Math.hypot(...skew) / 2;
  const cosine = (at(r, 0, 0) + at(r, 1, 1) + at(r, 2, 2) - 1) / 2;
  const angle = Math.atan2(sine, cosine);
  if (sine > 1e-9)
    return [(skew[0] * angle) / (2 * sine), (skew[1] * angle) / (2 * sine), (skew[2] * angle) / (2 * sine)];
  if (cosine > 0) return [skew[0] / 2, skew[1] / 2, skew[2] / 2];
  // Half a turn: the axis is in R + 1, whose columns are all multiples of it.
  const columns = [0, 1, 2].map((j) => [0, 1, 2].map((i) => at(r, i, j) + (i === j ? 1 : 0)));
  const axis = columns.reduce((best, column) => (Math.hypot(...column) > Math.hypot(...best) ? column : best));
  const length = Math.hypot(...axis);
  return [
    ((axis[0] ?? 0) / length) * Math.PI,
    ((axis[1] ?? 0) / length) * Math.PI,
    ((axis[2] ?? 0) / length) * Math.PI,
  ];
}

/** What the time offset gains from where the first holds to where the second does, and its standard deviation [s]: clocks of one
 *  recording that run apart; of two recordings nobody knows since when they have. As the server has it (`gained_s`). */
function gained(first: CalibrationResult, second: CalibrationResult): { value: number; sigma: number } {
  const [since, until] = [first.time_offset_at_s, second.time_offset_at_s];
  const [one, other] = [first.provenance.recording.sha256, second.provenance.recording.sha256];
  const known = [first, second]
    .filter((result) => typeof result.clock_rate_ppm === "number")
    .sort((a, b) => (a.clock_rate_ppm_std ?? Infinity) - (b.clock_rate_ppm_std ?? Infinity))[0];
  if (typeof since !== "number" || typeof until !== "number" || one === "" || one !== other || !known)
    return { value: 0, sigma: 0 };
  const scale = 1e-6 * (until - since);
  return { value: (known.clock_rate_ppm ?? 0) * scale, sigma: Math.abs((known.clock_rate_ppm_std ?? 0) * scale) };
}

/** How far the second answer is from the first, axis by axis; null where either has none. */
export function differences(first: CalibrationResult, second: CalibrationResult): Difference[] | null {
  const [a, b] = [first.T_imu_lidar, second.T_imu_lidar];
  const [ua, ub] = [first.uncertainty, second.uncertainty];
  if (a === null || b === null || ua === null || ub === null) return null;
  const deg = 180 / Math.PI;
  const both = (x: number | undefined, y: number | undefined) => Math.hypot(x ?? 0, y ?? 0);
  const gain = gained(first, second);
  return [
    ...xyz.map((axis, i): Difference => ({
      name: `Turn ${axis}`,
      unit: "°",
      value: wrapped((rotationBetween(a.matrix, b.matrix)[i] ?? 0) * deg),
      sigma: both(ua.rotation_std_deg[i], ub.rotation_std_deg[i]),
    })),
    ...xyz.map((axis, i): Difference => ({
      name: `Position ${axis}`,
      unit: "mm",
      value: ((b.translation_m[i] ?? 0) - (a.translation_m[i] ?? 0)) * 1000,
      sigma: both(ua.translation_std_m[i], ub.translation_std_m[i]) * 1000,
    })),
    {
      name: "Time offset",
      unit: "ms",
      value: ((second.time_offset_s ?? 0) - (first.time_offset_s ?? 0) - gain.value) * 1000,
      sigma: Math.hypot(ua.time_offset_std_s, ub.time_offset_std_s, gain.sigma) * 1000,
    },
  ];
}
