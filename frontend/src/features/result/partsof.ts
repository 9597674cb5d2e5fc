import type { CalibrationResult } from "../../api/client";
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

const axes = [
  ["x", "var(--axis-x)"],
  ["y", "var(--axis-y)"],
  ["z", "var(--axis-z)"],
] as const;

/** Bars longer than so many times the shorter ones (their quartile) may leave the plot. */
const longestBar = 5;

export function plotsOf(parts: readonly Part[]): PartsPlot[] {
  const perAxis = (shift: (part: Part) => readonly number[], std: (part: Part) => readonly number[], factor: number) =>
    axes.map(([label, color], i) => ({
      label,
      color,
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

/** How many bars of one standard deviation hold zero, and how many there are. */
export function crossingZero(parts: readonly Part[]): [number, number] {
  const within = parts.flatMap((part) => {
    const shifts = [...part.rotation_shift_deg, ...part.translation_shift_m, part.time_offset_shift_s];
    const stds = [...part.rotation_std_deg, ...part.translation_std_m, part.time_offset_std_s];
    return shifts.map((shift, i) => Math.abs(shift) <= (stds[i] ?? 0));
  });
  return [within.filter(Boolean).length, within.length];
}

/** Of readings that noise alone tells apart, so many lie within one standard deviation. */
const withinOneSigma = 0.6827;
/** Fewer than what chance alone leaves in all but one recording of so many are too few. */
const oneIn = 100;

/** Whether so few bars crossing zero are what noise explains, by the binomial law, as the report says it. */
export function asChanceHas(crossing: number, bars: number): string {
  let log = bars * Math.log(1 - withinOneSigma);
  let soFew = 0;
  for (let k = 0; k <= crossing; k += 1) {
    soFew += Math.exp(log);
    log += Math.log((bars - k) / (k + 1)) + Math.log(withinOneSigma / (1 - withinOneSigma));
  }
  return soFew < 1 / oneIn ? "fewer than noise explains" : "as noise has it";
}

/** Milliseconds from the answer's time offset of every value of a profile. */
export function offsetsOf(profile: Profile): number[] {
  return profile.likeness.map((_, i) => Math.round(1e6 * (profile.first_s + i * profile.step_s)) / 1e3);
}
