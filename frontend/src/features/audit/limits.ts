import type { Limits as Served, NewAudit } from "../../api/client";
import { numberOf } from "../../ui/format";

export type Limits = NonNullable<NewAudit["limits"]>;

/** Limits as they are typed: one number, three for x y z, or nothing where it is not judged. */
export interface LimitsText {
  rotation: string;
  translation: string;
  time: string;
}

/** The limits beyond which a result of our own would be called weak, as they would be typed; nothing until they are told. */
export function limitsText({ rotation_deg, translation_m, time_offset_s }: Served): LimitsText {
  const text = (value: number) => (Number.isFinite(value) ? String(Number(value.toPrecision(6))) : "");
  return { rotation: text(rotation_deg), translation: text(1000 * translation_m), time: text(1000 * time_offset_s) };
}

/** What is meant; null while a number is unfinished, not above nought, or nothing at all is judged. */
export function limitsOf({ rotation, translation, time }: LimitsText): Partial<Limits> | null {
  const turns = oneOrThree(rotation);
  const places = oneOrThree(translation);
  const clock = oneOrThree(time);
  if (turns === undefined || places === undefined || clock === undefined || Array.isArray(clock)) return null;
  if (turns === null && places === null && clock === null) return null;
  return { rotation_deg: turns, translation_mm: places, time_offset_ms: clock };
}

type Limit = number | [number, number, number] | null;

function oneOrThree(text: string): Limit | undefined {
  const words = text.split(/[\s;]+/).filter((word) => word !== "");
  if (words.length === 0) return null;
  const numbers = words.map(numberOf);
  if (numbers.some((value) => value === null || value <= 0)) return undefined;
  const [first, second, third] = numbers;
  if (words.length === 1 && typeof first === "number") return first;
  if (words.length === 3 && typeof first === "number" && typeof second === "number" && typeof third === "number")
    return [first, second, third];
  return undefined;
}

/** Kept for the next recording: limits belong to a rig's use, not to one recording. */
const place = "unsweep audit limits";

export function rememberedLimits(usual: LimitsText): LimitsText {
  try {
    const kept: unknown = JSON.parse(window.localStorage.getItem(place) ?? "null");
    if (typeof kept !== "object" || kept === null) return usual;
    const text = (name: keyof LimitsText) => {
      const value = (kept as Partial<Record<keyof LimitsText, unknown>>)[name];
      return typeof value === "string" ? value : usual[name];
    };
    return { rotation: text("rotation"), translation: text("translation"), time: text("time") };
  } catch {
    return usual;
  }
}

export function rememberLimits(limits: LimitsText): void {
  try {
    window.localStorage.setItem(place, JSON.stringify(limits));
  } catch {
    // A browser that keeps nothing asks again next time.
  }
}
