import type { NewJob } from "../../api/client";
import { perUnit, type Axis } from "../../ui/axes";
import { numberOf } from "../../ui/format";

export type Settings = NonNullable<NewJob["settings"]>;
export type Prior = NonNullable<Settings["priors"]>[number];

/** A prior as it is typed: numbers as text, in the units that people read. */
export interface PriorText {
  axis: Axis;
  value: string;
  sigma: string;
}

/** The prior that is meant; null while it is unfinished. A standard deviation is larger than nought. */
export function priorOf({ axis, value, sigma }: PriorText): Prior | null {
  const [mean, std] = [numberOf(value), numberOf(sigma)];
  if (mean === null || std === null || std <= 0) return null;
  return { axis, value: mean / perUnit(axis), std: std / perUnit(axis) };
}

export function priorText({ axis, value, std }: Prior): PriorText {
  const read = (number: number) => String(Number((number * perUnit(axis)).toPrecision(6)));
  return { axis, value: read(value), sigma: read(std) };
}

/** Normal gravity at sea level on the WGS 84 ellipsoid, m/s² (Somigliana's closed formula). */
export function gravityAt(latitudeDeg: number): number {
  const s2 = Math.sin((latitudeDeg * Math.PI) / 180) ** 2;
  return (9.7803253359 * (1 + 0.00193185265241 * s2)) / Math.sqrt(1 - 0.00669437999014 * s2);
}

/** The latitude [°], north or south, to ten metres of way, at which gravity is so large; null where it is nowhere. */
export function latitudeOf(magnitude_m_s2: number): number | null {
  let [low, high] = [0, 90];
  if (magnitude_m_s2 < gravityAt(low) || magnitude_m_s2 > gravityAt(high)) return null;
  while (high - low > 1e-9) {
    const middle = (low + high) / 2;
    if (gravityAt(middle) < magnitude_m_s2) low = middle;
    else high = middle;
  }
  return Number(high.toFixed(4));
}
