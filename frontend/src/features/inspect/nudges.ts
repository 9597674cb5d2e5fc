import type { View } from "../../api/client";
import type { components } from "../../api/generated/schema";

export type Nudge = components["schemas"]["Nudge"];
export type NudgeKey = keyof Nudge;

export interface NudgeAxis {
  key: NudgeKey;
  label: string;
  unit: "°" | "cm" | "ms";
  /** Of one step, in the field's own unit. */
  step: number;
  most: number;
  /** Shown value = field x factor. */
  factor: number;
}

export const nudgeAxes: readonly NudgeAxis[] = [
  { key: "rx_deg", label: "Turn about x", unit: "°", step: 1, most: 30, factor: 1 },
  { key: "ry_deg", label: "Turn about y", unit: "°", step: 1, most: 30, factor: 1 },
  { key: "rz_deg", label: "Turn about z", unit: "°", step: 1, most: 30, factor: 1 },
  { key: "tx_m", label: "Shift along x", unit: "cm", step: 0.01, most: 2, factor: 100 },
  { key: "ty_m", label: "Shift along y", unit: "cm", step: 0.01, most: 2, factor: 100 },
  { key: "tz_m", label: "Shift along z", unit: "cm", step: 0.01, most: 2, factor: 100 },
  { key: "dt_s", label: "Time offset", unit: "ms", step: 0.001, most: 0.5, factor: 1000 },
];

const shownM = 1e-4;

export const noNudge: Nudge = { rx_deg: 0, ry_deg: 0, rz_deg: 0, tx_m: 0, ty_m: 0, tz_m: 0, dt_s: 0 };

/** One step more or less, kept within bounds and free of binary dust. */
export function stepped(nudge: Nudge, axis: NudgeAxis, steps: number): Nudge {
  const wanted = nudge[axis.key] + steps * axis.step;
  const value = Math.round(Math.max(-axis.most, Math.min(axis.most, wanted)) * 1e6) / 1e6;
  return { ...nudge, [axis.key]: value };
}

/** Whether a shift alone leaves the walls as they are, to the tenth of a millimetre that is shown: who sees that takes the lever arm
 *  for unknown. */
export function wallsAreSilent(nudge: Nudge, blur: NonNullable<View["blur"]>): boolean {
  const shifted = nudgeAxes.every(({ key }) => key.startsWith("t") || nudge[key] === 0);
  return shifted && writeNudge(nudge) !== "" && blur.nudged_rms_m - blur.solved_rms_m < shownM;
}

/** `rz_deg:2,dt_s:-0.001`; empty for no nudge. */
export function writeNudge(nudge: Nudge): string {
  return nudgeAxes
    .filter(({ key }) => nudge[key] !== 0)
    .map(({ key }) => `${key}:${nudge[key]}`)
    .join(",");
}

export function parseNudge(text: string): Nudge {
  const nudge = { ...noNudge };
  for (const part of text.split(",")) {
    const [key, value] = part.split(":");
    const axis = nudgeAxes.find((one) => one.key === key);
    const number = Number(value);
    if (axis !== undefined && Number.isFinite(number))
      nudge[axis.key] = Math.max(-axis.most, Math.min(axis.most, number));
  }
  return nudge;
}
