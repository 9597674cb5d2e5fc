import type { CalibrationResult } from "../../api/client";

/** Beyond it nothing is known of a length: as the tables beside it have it. */
const unknownM = 1;

/** How far apart the sensors are and its standard deviation [m], the same in either direction; null where it is as good as unknown.
 *
 *  What is known badly across the line between them counts by how much longer it makes that line, which matters for a short one.
 */
export function distanceOf(result: CalibrationResult): { m: number; sigmaM: number } | null {
  const { T_imu_lidar: transform, uncertainty } = result;
  if (transform === null || uncertainty === null) return null;
  const largest = Math.max(...uncertainty.translation_std_m);
  if (largest >= unknownM) return null;
  const p = transform.translation_m;
  const m = Math.hypot(...p);
  if (m === 0) return { m, sigmaM: largest };
  const at = (i: number, j: number) => uncertainty.covariance[3 + i]?.[3 + j] ?? 0;
  const axes = [0, 1, 2];
  const along = axes.flatMap((i) => axes.map((j) => ((p[i] ?? 0) / m) * at(i, j) * ((p[j] ?? 0) / m)));
  const alongVariance = Math.max(
    0,
    along.reduce((sum, value) => sum + value, 0),
  );
  const across = Math.max(0, at(0, 0) + at(1, 1) + at(2, 2) - alongVariance);
  return { m, sigmaM: Math.min(largest, Math.hypot(Math.sqrt(alongVariance), across / (2 * m))) };
}
