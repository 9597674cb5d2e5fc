/** Numbers as people read them. Everything arrives in SI units and radians-free; units are said in the function's name. */

/** A narrow space that does not break: between a number and its unit or sign. */
export const NARROW = "\u202f";

export function bytes(n: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = n;
  let unit = 0;
  while (value >= 999.5 && unit < units.length - 1) {
    value /= 1000;
    unit += 1;
  }
  return `${unit === 0 || value >= 99.5 ? value.toFixed(0) : value.toPrecision(value >= 9.95 ? 3 : 2)}${NARROW}${units[unit] ?? ""}`;
}

/** A duration in seconds, coarse enough to be read at a glance. */
export function duration(seconds: number): string {
  if (!Number.isFinite(seconds) || seconds < 0) return "–";
  if (seconds < 9.95) return `${seconds.toFixed(1)}${NARROW}s`;
  if (seconds < 99.5) return `${seconds.toFixed(0)}${NARROW}s`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 60) return `${minutes}${NARROW}min ${String(Math.round(seconds % 60)).padStart(2, "0")}${NARROW}s`;
  return `${Math.floor(minutes / 60)}${NARROW}h ${String(minutes % 60).padStart(2, "0")}${NARROW}min`;
}

export function count(n: number): string {
  return n.toLocaleString("en-US").replaceAll(",", NARROW);
}

/** A number with a fixed number of decimals and a real minus sign. */
export function fixed(value: number, decimals: number): string {
  if (!Number.isFinite(value)) return "–";
  const text = value.toFixed(decimals);
  const zero = Number(text) === 0;
  return (zero ? Math.abs(Number(text)).toFixed(decimals) : text).replace("-", "−");
}

/** Decimals that show a standard deviation with two significant digits, and no more than `most`. */
export function decimalsFor(sigma: number, most = 4): number {
  if (!(sigma > 0) || !Number.isFinite(sigma)) return most;
  return Math.min(most, Math.max(0, 1 - Math.floor(Math.log10(sigma))));
}

export interface ValueText {
  value: string;
  sigma: string;
}

/** A value and its standard deviation, both with the decimals the standard deviation deserves. */
export function withSigma(value: number, sigma: number, most = 4): ValueText {
  const decimals = decimalsFor(sigma, most);
  const least = 10 ** -decimals;
  return {
    value: fixed(value, decimals),
    sigma: sigma > 0 && sigma < least ? `<${NARROW}${fixed(least, decimals)}` : boundless(sigma, decimals),
  };
}

/**
 * A standard deviation of an angle, a length or a time, in the unit that people read and with two significant digits;
 * beyond a metre or a second in these, as the terminal and the report have it.
 */
export function stdText(std: number, unit: "deg" | "m" | "s"): string {
  if (unit === "deg") return `${twoDigits(std)}°`;
  return std >= 1 ? `${twoDigits(std)} ${unit}` : `${twoDigits(std * 1000)} m${unit}`;
}

export function twoDigits(value: number): string {
  return boundless(value, Math.max(0, 1 - Math.floor(Math.log10(Math.max(value, 1e-9)))));
}

/** Beyond a metre or a second nothing is known, and how much of nothing is no number to read. */
function boundless(value: number, decimals: number): string {
  return value >= 1000 ? `>${NARROW}1000` : fixed(value, decimals);
}

/** An angle as every document and screen has it: above -180 degrees, up to 180. */
export function wrapped(degrees: number): number {
  const turned = degrees - 360 * Math.round(degrees / 360);
  return turned <= -180 ? turned + 360 : turned;
}

/** A number as people type it; null where it is none. */
export function numberOf(text: string): number | null {
  const trimmed = text.trim().replace("−", "-").replace(",", ".");
  const value = Number(trimmed);
  return trimmed === "" || !Number.isFinite(value) ? null : value;
}

/** "3 minutes ago" for a past instant; both in milliseconds since the epoch. */
export function ago(then: number, now: number): string {
  const seconds = Math.max(0, (now - then) / 1000);
  if (seconds < 45) return "just now";
  const steps: [number, Intl.RelativeTimeFormatUnit][] = [
    [60, "minute"],
    [3600, "hour"],
    [86400, "day"],
    [86400 * 30, "month"],
    [86400 * 365, "year"],
  ];
  const fit = [...steps].reverse().find(([size]) => seconds >= size * 0.9) ?? [60, "minute"];
  return new Intl.RelativeTimeFormat("en", { numeric: "auto" }).format(
    -Math.max(1, Math.round(seconds / fit[0])),
    fit[1],
  );
}
