import type { NewJob } from "../../api/client";

export type Settings = NonNullable<NewJob["settings"]>;
export type Prior = NonNullable<Settings["priors"]>[number];
export type Axis = Prior["axis"];

export const axes: readonly Axis[] = ["rx", "ry", "rz", "tx", "ty", "tz", "dt"];

/** A prior as it is typed: numbers as text, in the units that people read. */
export interface PriorText {
  axis: Axis;
  value: string;
  sigma: string;
}

/** How many of a person's units the document's is: degrees to a radian, millimetres to a metre, milliseconds to a second. */
function units(axis: Axis): number {
  return axis.startsWith("r") ? 180 / Math.PI : 1000;
}

export function unitOf(axis: Axis): "°" | "mm" | "ms" {
  return axis.startsWith("r") ? "°" : axis === "dt" ? "ms" : "mm";
}

/** A number as people type it; null where it is none. */
export function numberOf(text: string): number | null {
  const trimmed = text.trim().replace("−", "-").replace(",", ".");
  const value = Number(trimmed);
  return trimmed === "" || !Number.isFinite(value) ? null : value;
}

/** The prior that is meant; null while it is unfinished. A standard deviation is larger than nought. */
export function priorOf({ axis, value, sigma }: PriorText): Prior | null {
  const [mean, std] = [numberOf(value), numberOf(sigma)];
  if (mean === null || std === null || std <= 0) return null;
  return { axis, value: mean / units(axis), std: std / units(axis) };
}

export function priorText({ axis, value, std }: Prior): PriorText {
  const read = (number: number) => String(Number((number * units(axis)).toPrecision(6)));
  return { axis, value: read(value), sigma: read(std) };
}

/** Normal gravity at sea level on the WGS 84 ellipsoid, m/s² (Somigliana's closed formula). */
export function gravityAt(latitudeDeg: number): number {
  const s2 = Math.sin((latitudeDeg * Math.PI) / 180) ** 2;
  return (9.7803253359 * (1 + 0.00193185265241 * s2)) / Math.sqrt(1 - 0.00669437999014 * s2);
}
