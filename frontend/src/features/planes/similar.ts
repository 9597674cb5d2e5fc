import type { Patch, Usual } from "../../api/client";

/** Patches that could be one plane with this one: nearly parallel and at nearly the same place, nearest first. */
export function mergeCandidates(
  patch: Patch,
  all: readonly Patch[],
  usual: Pick<Usual, "merge_within_deg" | "merge_within_m">,
): Patch[] {
  const dot = (other: Patch) => patch.normal.reduce((sum, n, axis) => sum + n * (other.normal[axis] ?? 0), 0);
  return all
    .filter((other) => other.index !== patch.index)
    .map((other) => {
      const cos = dot(other);
      const apart = Math.abs(patch.offset_m - Math.sign(cos) * other.offset_m);
      return { other, angleDeg: (Math.acos(Math.min(1, Math.abs(cos))) * 180) / Math.PI, apart };
    })
    .filter(({ angleDeg, apart }) => angleDeg <= usual.merge_within_deg && apart <= usual.merge_within_m)
    .sort((a, b) => a.apart - b.apart)
    .map(({ other }) => other);
}
