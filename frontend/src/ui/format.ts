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
  // Rounded before it is taken apart: 119.6 s are 2 min, not 1 min and 60 s.
  const whole = Math.round(seconds);
  if (whole < 3600) return parts(Math.floor(whole / 60), "min", whole % 60, "s");
  const minutes = Math.round(seconds / 60);
  return parts(Math.floor(minutes / 60), "h", minutes % 60, "min");
}

function parts(large: number, unit: string, small: number, smallUnit: string): string {
  return `${large}${NARROW}${unit} ${String(small).padStart(2, "0")}${NARROW}${smallUnit}`;
}

export function count(n: number): string {
  return n.toLocaleString("en-US").replaceAll(",", NARROW);
}

/** The whole percent that are done: 100 only when all is. */
export function percentOf(fraction: number): number {
  return Math.floor(fraction * 100 + 1e-9);
}

/** A number with a fixed number of decimals and a real minus sign. */
export function fixed(value: number, decimals: number): string {
  if (!Number.isFinite(value)) return "–";
  const text = value.toFixed(decimals);
  const zero = Number(text) === 0;
  return (zero ? Math.abs(Number(text)).toFixed(decimals) : text).replace("-", "−");
}

/** Decimals that show a standard deviation with two significant digits. */
export function decimalsFor(sigma: number): number {
  return decimalsOf(Math.max(sigma, 1e-9), 2);
}

/** Decimals that show so many significant digits of a number that is not 0. */
function decimalsOf(value: number, digits: number): number {
  // Rounded first: 0.996 has its two digits one place further left than it seems.
  const rounded = Math.abs(Number(value.toExponential(digits - 1)));
  return Math.max(0, digits - 1 - Math.floor(Math.log10(rounded)));
}

/** A number with three significant digits, written out: 1000 for 999.6, where JavaScript has 1.00e+3. */
export function threeDigits(value: number): string {
  return fixed(value, value === 0 ? 2 : Math.min(12, decimalsOf(value, 3)));
}

/** In what a usual standard deviation is read, and in what a large one. */
const larger = { "°": "°", mm: "m", ms: "s" } as const;
export type SmallUnit = keyof typeof larger;
export type Unit = SmallUnit | "m" | "s";

const notDetermined = "not determined";
const halfCircle = 180;

/** Whether a standard deviation [mm, ms, °] is so wide that what it stands beside is as good as unknown: a metre, a second, half a
 *  circle. */
export function tellsNothing(sigma: number, unit: SmallUnit): boolean {
  return sigma >= (unit === "°" ? halfCircle : 1000);
}

export interface ValueText {
  value: string;
  sigma: string;
  /** That both are in. */
  unit: Unit;
}

/**
 * A value and its standard deviation [mm, ms, °], both with the decimals that the standard deviation deserves: two significant
 * digits of it, and beyond a metre or a second in these. The one rule of tables and sentences; the terminal, the report and what
 * the server says have the same (`calib_core/sigmas.py`).
 */
export function withSigma(value: number, sigma: number, unit: SmallUnit): ValueText {
  const shown = tellsNothing(sigma, unit) && unit !== "°" ? 0.001 : 1;
  return {
    value: toSigma(value * shown, sigma * shown),
    sigma: tellsNothing(sigma, unit) && unit === "°" ? notDetermined : twoDigits(sigma * shown),
    unit: shown === 1 ? unit : larger[unit],
  };
}

/** A value with the decimals that show two significant digits of its standard deviation. */
export function toSigma(value: number, sigma: number): string {
  return fixed(value, sigma > 0 ? decimalsFor(sigma) : 4);
}

/**
 * Roll, pitch and yaw [°], to the digits that the surest turn deserves. None has a standard deviation of its own: these are of turns
 * about the lidar's axes, which roll, pitch and yaw are not once the lidar lies on its side.
 */
export function anglesText(degrees: readonly number[], turnStdsDeg: readonly (number | null)[]): string[] {
  const surest = Math.min(...turnStdsDeg.filter((std) => std !== null));
  return degrees.map((angle) => (Number.isFinite(surest) ? toSigma(wrapped(angle), surest) : fixed(wrapped(angle), 3)));
}

/** What was held at a value, of which its standard deviation says nothing. */
export function heldText(value: number, unit: SmallUnit): ValueText {
  return { value: fixed(value, unit === "mm" ? 1 : 3), sigma: "held", unit };
}

/** The standard deviation of a text, as it stands beside the value. */
export function plusMinus({ sigma }: Pick<ValueText, "sigma">): string {
  return /^[\d.]+$/.test(sigma) ? `± ${sigma}` : sigma;
}

/** A standard deviation [deg, m, s] with its unit, by the same rule. */
export function stdText(std: number, unit: "deg" | "m" | "s"): string {
  const small = unit === "deg" ? "°" : (`m${unit}` as const);
  const text = withSigma(0, unit === "deg" ? std : std * 1000, small);
  if (text.sigma === notDetermined) return notDetermined;
  return `${text.sigma}${text.unit === "°" ? "" : " "}${text.unit}`;
}

/** The same behind its sign. */
export function plusMinusStd(std: number, unit: "deg" | "m" | "s"): string {
  const text = stdText(std, unit);
  return text === notDetermined ? text : `± ${text}`;
}

/** The same of a forecast [deg, m, s] that may rest on what is known beforehand alone: a prior's metre is no forecast. */
export function foreseenText(std: number, unit: "deg" | "m" | "s", weak: boolean): string {
  const nothing = std >= (unit === "deg" ? halfCircle : 1);
  return weak && nothing ? "unknown" : plusMinusStd(std, unit).replace("± ", `±${NARROW}`);
}

export function twoDigits(value: number): string {
  return value <= 0 ? "0" : fixed(value, decimalsFor(value));
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
