import type { CalibrationResult } from "../../api/client";

type Matrix = readonly (readonly number[])[];
export type Direction = "imu_lidar" | "lidar_imu";

export interface Pose {
  matrix: number[][];
  translationM: number[];
  quaternionXyzw: number[];
  eulerDeg: number[];
  /** About the axes of the frame that the pose takes points from. */
  rotationStdDeg: number[];
  /** Along the axes of the frame that the pose takes points to. */
  translationStdM: number[];
}

const at = (m: Matrix, row: number, column: number): number => m[row]?.[column] ?? 0;

function multiply(a: Matrix, b: Matrix): number[][] {
  return a.map((row) => (b[0] ?? []).map((_, j) => row.reduce((sum, value, k) => sum + value * at(b, k, j), 0)));
}

function transposed(m: Matrix): number[][] {
  return (m[0] ?? []).map((_, j) => m.map((row) => row[j] ?? 0));
}

/** R with matrix = R, R = Rz(yaw) Ry(pitch) Rx(roll), as degrees roll, pitch, yaw. */
export function eulerDeg(m: Matrix): number[] {
  const deg = 180 / Math.PI;
  const flat = Math.hypot(at(m, 0, 0), at(m, 1, 0));
  const pitch = Math.atan2(-at(m, 2, 0), flat);
  if (flat < 1e-9) return [Math.atan2(-at(m, 1, 2), at(m, 1, 1)) * deg, pitch * deg, 0];
  return [Math.atan2(at(m, 2, 1), at(m, 2, 2)) * deg, pitch * deg, Math.atan2(at(m, 1, 0), at(m, 0, 0)) * deg];
}

/** T_lidar_imu and its standard deviations, from T_imu_lidar and the contract's 7x7 covariance.
 *
 *  With R Exp(r) and p + d: the inverse's rotation is Exp(-r) R^T = R^T Exp(-R r), and its translation
 *  p' = -R^T p moves by [p']x r - R^T d to first order.
 */
export function inverted(matrix: Matrix, covariance: Matrix): Pose {
  const R = [0, 1, 2].map((i) => [0, 1, 2].map((j) => at(matrix, i, j)));
  const Rt = transposed(R);
  const p = [0, 1, 2].map((i) => [at(matrix, i, 3)]);
  const moved = multiply(Rt, p).map(([value]) => -(value ?? 0));
  const [x = 0, y = 0, z = 0] = moved;
  const cross = [
    [0, -z, y],
    [z, 0, -x],
    [-y, x, 0],
  ];
  const rotation = R.map((row) => [...row.map((value) => -value), 0, 0, 0]);
  const translation = cross.map((row, i) => [...row, ...(Rt[i] ?? []).map((value) => -value)]);
  const cov6 = covariance.slice(0, 6).map((row) => row.slice(0, 6));
  const std = (J: Matrix) => {
    const cov = multiply(multiply(J, cov6), transposed(J));
    return [0, 1, 2].map((i) => Math.sqrt(Math.max(0, at(cov, i, i))));
  };
  return {
    matrix: [...Rt.map((row, i) => [...row, moved[i] ?? 0]), [0, 0, 0, 1]],
    translationM: moved,
    quaternionXyzw: [],
    eulerDeg: eulerDeg(Rt),
    rotationStdDeg: std(rotation).map((value) => (value * 180) / Math.PI),
    translationStdM: std(translation),
  };
}

/** The answer in the wanted direction; null where the recording was refused. */
export function poseOf(result: CalibrationResult, direction: Direction): Pose | null {
  const { T_imu_lidar: transform, uncertainty } = result;
  if (transform === null || uncertainty === null) return null;
  const [qx = 0, qy = 0, qz = 0, qw = 1] = transform.quaternion_xyzw;
  switch (direction) {
    case "imu_lidar":
      return {
        matrix: transform.matrix,
        translationM: transform.translation_m,
        quaternionXyzw: transform.quaternion_xyzw,
        eulerDeg: transform.euler_xyz_deg,
        rotationStdDeg: uncertainty.rotation_std_deg,
        translationStdM: uncertainty.translation_std_m,
      };
    case "lidar_imu":
      return { ...inverted(transform.matrix, uncertainty.covariance), quaternionXyzw: [-qx, -qy, -qz, qw] };
  }
}
