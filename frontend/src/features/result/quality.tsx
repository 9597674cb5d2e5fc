import type { CalibrationResult } from "../../api/client";
import { count, duration, fixed } from "../../ui/format";
import css from "./result.module.css";

/** What the answer rests on. */
export function Quality({ result }: { result: CalibrationResult }) {
  const { quality, provenance } = result;
  const facts: [string, string][] = [
    ["Points used", count(quality.points_used)],
    ["Scans used", `${count(quality.scans_used)} of ${count(quality.scans_total)}`],
    ["Points to planes, rms", `${fixed(quality.point_to_plane_rms_m * 1000, 2)} mm`],
    ["Gravity", result.gravity_m_s2 === null ? "–" : `${fixed(result.gravity_m_s2, 4)} m/s²`],
    ["Gyroscope bias", vector(result.gyroscope_bias_rad_s, 1000, 3, "mrad/s")],
    ["Accelerometer bias", vector(result.accelerometer_bias_m_s2, 1000, 1, "mm/s²")],
    ["Iterations", count(quality.iterations)],
    ["Took", duration(quality.duration_s)],
    ["Lidar", provenance.recording.lidar_topic],
    ["IMU", provenance.recording.imu_topic],
  ];
  return (
    <section aria-label="What the answer rests on">
      <h2>What it rests on</h2>
      <dl className={css.facts}>
        {facts.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd className="num clip" title={value}>
              {value}
            </dd>
          </div>
        ))}
      </dl>
    </section>
  );
}

function vector(values: readonly number[] | null, factor: number, decimals: number, unit: string): string {
  return values === null ? "–" : `${values.map((value) => fixed(value * factor, decimals)).join("  ")} ${unit}`;
}
