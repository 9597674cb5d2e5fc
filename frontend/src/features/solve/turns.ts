type Quaternion = readonly [number, number, number, number];

/** Of R = Rz(yaw) Ry(pitch) Rx(roll), as w x y z. */
function quaternionOf(eulerDeg: readonly number[]): Quaternion {
  const half = eulerDeg.map((angle) => (angle * Math.PI) / 360);
  const [cr = 1, cp = 1, cy = 1] = half.map(Math.cos);
  const [sr = 0, sp = 0, sy = 0] = half.map(Math.sin);
  return [
    cr * cp * cy + sr * sp * sy,
    sr * cp * cy - cr * sp * sy,
    cr * sp * cy + sr * cp * sy,
    cr * cp * sy - sr * sp * cy,
  ];
}

/** The turn r [°] about the lidar's axes from one rotation to another, both as roll, pitch and yaw [°]: R_from Exp(r) = R_to. */
export function turnDeg(from: readonly number[], to: readonly number[]): number[] {
  const [a, b, c, d] = quaternionOf(from);
  const [w, x, y, z] = quaternionOf(to);
  const real = a * w + b * x + c * y + d * z;
  const axis = [a * x - b * w - c * z + d * y, a * y + b * z - c * w - d * x, a * z - b * y + c * x - d * w];
  const length = Math.hypot(...axis);
  // Both signs of a quaternion are the same rotation; the shorter way round is meant.
  const angle = 2 * Math.atan2(length, Math.abs(real)) * (real < 0 ? -1 : 1);
  return axis.map((part) => (length === 0 ? 0 : ((part / length) * angle * 180) / Math.PI));
}
