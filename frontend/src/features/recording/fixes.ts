import type { ChangeRecording, FindingReport, ReadSettings } from "../../api/client";
import { controlName, sentenceCase, valueName } from "../../ui/words";

type SettingKey = Exclude<keyof ReadSettings, "start_s" | "end_s">;
type Kind = "text" | "number" | "flag";

/** What each option of the command line changes of a recording, and how its value is written. */
const kinds: Record<SettingKey, Kind> = {
  lidar_topic: "text",
  imu_topic: "text",
  point_time_field: "text",
  point_time_unit: "text",
  point_time_reference: "text",
  synthesise_point_time: "flag",
  points_at_once: "flag",
  accelerometer_unit: "text",
  gyroscope_unit: "text",
  stamps: "text",
  imu_bundles: "text",
  repeated_returns: "text",
  range_min_m: "number",
  range_max_m: "number",
};

function isSetting(key: string): key is SettingKey {
  return key in kinds;
}

/** The change that an override such as `--point-time-unit ns` stands for; null where the browser has no such setting. */
export function fixOf(override: string): ChangeRecording | null {
  const words = override
    .trim()
    .split(/\s+/)
    .filter((word) => word !== "");
  const change: Record<string, string | number | boolean> = {};
  for (let i = 0; i < words.length; i += 1) {
    const word = words[i] ?? "";
    if (!word.startsWith("--")) return null;
    const key = word.slice(2).replaceAll("-", "_");
    if (!isSetting(key)) return null;
    if (kinds[key] === "flag") {
      change[key] = true;
      continue;
    }
    i += 1;
    const value = words[i];
    if (value === undefined || value.startsWith("--")) return null;
    change[key] = kinds[key] === "number" ? Number(value) : value;
  }
  return Object.keys(change).length > 0 ? change : null;
}

const units = { "imu.accelerometer_unit": "accelerometer_unit", "imu.gyroscope_unit": "gyroscope_unit" } as const;

/** Whether a button offers the override. What is beyond doubt needs none; a unit that the readings themselves tell is so even where
 *  it is the rarer one, of which a person is warned, but not one that somebody asked for. */
export function isOffered(
  finding: Pick<FindingReport, "code" | "level" | "confidence" | "override">,
  read: Pick<ReadSettings, "accelerometer_unit" | "gyroscope_unit">,
): boolean {
  if (fixOf(finding.override) === null) return false;
  if (finding.confidence < 0.95) return true;
  const unit = Object.entries(units).find(([code]) => code === finding.code)?.[1];
  return finding.level !== "info" && (unit === undefined || (read[unit] ?? null) !== null);
}

/** The override in the words of the control that it sets: `Set “Gyroscope unit” to °/s`. */
export function fixText(override: string): string {
  const text = override
    .trim()
    .split(/\s*--/)
    .filter((part) => part !== "")
    .map((part) => {
      const [name = "", ...value] = part.split(/\s+/);
      const control = `“${controlName(name)}”`;
      return value.length === 0 ? `switch on ${control}` : `set ${control} to ${value.map(valueName).join(" ")}`;
    })
    .join(", ");
  return sentenceCase(text);
}
