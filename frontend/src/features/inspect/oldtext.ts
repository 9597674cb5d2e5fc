import type { OldExtrinsic } from "../../api/client";

/** `x,y,z,qx,qy,qz,qw` and, where it is known, the time offset: an extrinsic in a URL. */
export function writeOld(old: OldExtrinsic): string {
  const numbers = [...old.translation_m, ...old.quaternion_xyzw];
  if (old.time_offset_s !== null && old.time_offset_s !== undefined) numbers.push(old.time_offset_s);
  return numbers.map((value) => String(Number(value.toFixed(9)))).join(",");
}

/** The extrinsic that a URL names; null for none, or for what is none. */
export function parseOld(text: string): OldExtrinsic | null {
  const numbers = text.split(",").map(Number);
  if (text === "" || numbers.length < 7 || numbers.length > 8 || !numbers.every(Number.isFinite)) return null;
  const [x = 0, y = 0, z = 0, qx = 0, qy = 0, qz = 0, qw = 1, offset = null] = numbers;
  if (Math.abs(Math.hypot(qx, qy, qz, qw) - 1) > 0.01) return null;
  return { translation_m: [x, y, z], quaternion_xyzw: [qx, qy, qz, qw], time_offset_s: offset };
}
