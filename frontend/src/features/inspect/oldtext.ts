import type { OldExtrinsic } from "../../api/client";

/** `x,y,z,qx,qy,qz,qw`, where it is known the time offset, and behind a semicolon what it is called: an extrinsic in a URL. */
export function writeOld(old: OldExtrinsic): string {
  const numbers = [...old.translation_m, ...old.quaternion_xyzw];
  if (old.time_offset_s !== null && old.time_offset_s !== undefined) numbers.push(old.time_offset_s);
  const text = numbers.map((value) => String(Number(value.toFixed(9)))).join(",");
  return old.name === "" ? text : `${text};${old.name}`;
}

/** As long as a name may be. */
const longest = 80;

/** The extrinsic that a URL names; null for none, or for what is none. */
export function parseOld(text: string): OldExtrinsic | null {
  const [figures = "", ...rest] = text.split(";");
  const name = rest.join(";").slice(0, longest);
  const numbers = figures.split(",").map(Number);
  if (figures === "" || numbers.length < 7 || numbers.length > 8 || !numbers.every(Number.isFinite)) return null;
  const [x = 0, y = 0, z = 0, qx = 0, qy = 0, qz = 0, qw = 1, offset = null] = numbers;
  if (Math.abs(Math.hypot(qx, qy, qz, qw) - 1) > 0.01) return null;
  return { translation_m: [x, y, z], quaternion_xyzw: [qx, qy, qz, qw], time_offset_s: offset, name };
}

/** What it is called: another run by its name, and only what is nobody's run an old extrinsic. */
export function nameOfOld(old: OldExtrinsic | null, unnamed: string): string {
  return old === null || old.name === "" ? unnamed : old.name;
}
