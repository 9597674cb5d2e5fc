import type { CalibrationResult } from "../../api/client";

interface Words {
  flag: string;
  of: (settings: Record<string, unknown>) => string | null;
}

const text = (value: unknown): string | null => (typeof value === "string" || typeof value === "number" ? String(value) : null);

const options: readonly Words[] = [
  { flag: "--method", of: (s) => (s["method"] === "paper" ? "paper" : null) },
  {
    flag: "--points-per-plane-per-scan",
    of: (s) => (s["method"] === "paper" && s["points_per_plane_per_scan"] === 100 ? null : text(s["points_per_plane_per_scan"])),
  },
  { flag: "--field-of-view-deg", of: (s) => (s["method"] === "paper" && s["field_of_view_deg"] === 45 ? null : text(s["field_of_view_deg"])) },
  { flag: "--imu-noise", of: (s) => text(s["imu_noise"]) },
];

function quoted(word: string): string {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", `'\\''`)}'`;
}

/** The command that gives the same answer without a browser. The topics are named: they may have been a choice. */
export function commandOf(result: CalibrationResult): string {
  const { recording, settings } = result.provenance;
  const words = ["unsweep", "calibrate", quoted(recording.name)];
  words.push("--lidar-topic", quoted(recording.lidar_topic), "--imu-topic", quoted(recording.imu_topic));
  for (const { flag, of } of options) {
    const value = of(settings);
    if (value !== null) words.push(flag, quoted(value));
  }
  return [...words, "--output", "result.json"].join(" ");
}
