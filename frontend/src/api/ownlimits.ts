import { useLocalStorage } from "@mantine/hooks";
import type { CalibrationResult, Limits } from "./client";
import { xyz } from "../ui/axes";
import { plusMinusStd } from "../ui/format";

/** How well a rig has to be known for its use: one standard deviation, in the units that people read. */
export interface OwnLimits {
  deg: number;
  mm: number;
  ms: number;
}

/** This browser's own limits for every recording; null where the usual ones do. */
export function useOwnLimits() {
  const [own, setOwn] = useLocalStorage<OwnLimits | null>({
    key: "unsweep own limits",
    defaultValue: null,
    getInitialValueInEffect: false,
  });
  return { own: isOwn(own) ? own : null, setOwn };
}

/** What somebody else left under that name is no limit. */
function isOwn(kept: unknown): kept is OwnLimits {
  if (typeof kept !== "object" || kept === null) return false;
  const { deg, mm, ms } = kept as Partial<Record<keyof OwnLimits, unknown>>;
  return [deg, mm, ms].every((value) => typeof value === "number" && value > 0);
}

export function asLimits({ deg, mm, ms }: OwnLimits): Limits {
  return { rotation_deg: deg, translation_m: mm / 1000, time_offset_s: ms / 1000 };
}

/** The axes that are known less well than one's own limits ask, each with its sigma; null for a result without any. */
export function beyond(result: Pick<CalibrationResult, "uncertainty">, own: OwnLimits): string[] | null {
  const known = result.uncertainty;
  if (known === null) return null;
  const said = (name: string, std: number, limit: number, unit: "deg" | "m" | "s") =>
    std > limit ? [`${name} ${plusMinusStd(std, unit)}`] : [];
  return [
    ...xyz.flatMap((axis, i) => said(`position ${axis}`, known.translation_std_m[i] ?? 0, own.mm / 1000, "m")),
    ...xyz.flatMap((axis, i) => said(`turn ${axis}`, known.rotation_std_deg[i] ?? 0, own.deg, "deg")),
    ...said("time offset", known.time_offset_std_s, own.ms / 1000, "s"),
  ];
}
