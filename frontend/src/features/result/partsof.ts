import type { CalibrationResult } from "../../api/client";
import { colorOf, xyz } from "../../ui/axes";
import type { Line } from "../../ui/lineplot";

type Evidence = NonNullable<CalibrationResult["evidence"]>;
export type Part = Evidence["parts"]["time_blocks"][number];
export type Profile = NonNullable<Evidence["time_offset_profile"]>;

/** One plot of what parts answer: its lines, and the ends of an axis that holds all bars but those that say next to nothing. */
export interface PartsPlot {
  name: string;
  unit: string;
  lines: Line[];
  range: readonly [number, number];
}

/** Bars longer than so many times the shorter ones (their quartile) may leave the plot. */
const longestBar = 5;

export function plotsOf(parts: readonly Part[]): PartsPlot[] {
  const perAxis = (shift: (part: Part) => readonly number[], std: (part: Part) => readonly number[], factor: number) =>
    xyz.map((axis, i) => ({
      label: axis,
      color: colorOf(axis),
      values: parts.map((part) => (shift(part)[i] ?? 0) * factor),
      sigmas: parts.map((part) => (std(part)[i] ?? 0) * factor),
    }));
  const late = {
    label: "offset",
    color: "var(--accent)",
    values: parts.map((part) => part.time_offset_shift_s * 1000),
    sigmas: parts.map((part) => part.time_offset_std_s * 1000),
  };
  const turns = perAxis(
    (part) => part.rotation_shift_deg,
    (part) => part.rotation_std_deg,
    1,
  );
  const places = perAxis(
    (part) => part.translation_shift_m,
    (part) => part.translation_std_m,
    1000,
  );
  return [
    { name: "Rotation", unit: "°", lines: turns, range: rangeOf(turns) },
    { name: "Position", unit: "mm", lines: places, range: rangeOf(places) },
    { name: "Time offset", unit: "ms", lines: [late], range: rangeOf([late]) },
  ];
}

function rangeOf(lines: readonly { values: number[]; sigmas: number[] }[]): readonly [number, number] {
  const pairs = lines.flatMap((line) => line.values.map((value, i) => [Math.abs(value), line.sigmas[i] ?? 0] as const));
  const sorted = pairs.map(([, sigma]) => sigma).sort((a, b) => a - b);
  const quartile = sorted[Math.floor(sorted.length / 4)] ?? 0;
  const telling = pairs.filter(([, sigma]) => sigma <= longestBar * quartile);
  const reach = 1.1 * Math.max(1e-9, ...telling.map(([shift, sigma]) => shift + sigma));
  return [-reach, reach];
}

/** Milliseconds from the answer's time offset of every value of a profile. */
export function offsetsOf(profile: Profile): number[] {
  return profile.likeness.map((_, i) => Math.round(1e6 * (profile.first_s + i * profile.step_s)) / 1e3);
}
