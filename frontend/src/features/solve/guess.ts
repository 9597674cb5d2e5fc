import type { OldExtrinsic } from "../../api/client";

/** A pose as a 4 × 4 matrix, from a translation and a unit quaternion x y z w. */
export function matrixOf({
  translation_m: p,
  quaternion_xyzw: q,
}: Pick<OldExtrinsic, "translation_m" | "quaternion_xyzw">): number[][] {
  const [x = 0, y = 0, z = 0, w = 1] = q;
  const [px = 0, py = 0, pz = 0] = p;
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), px],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), py],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), pz],
    [0, 0, 0, 1],
  ];
}
