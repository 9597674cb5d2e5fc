import type { CalibrationResult } from "../../api/client";
import { count, duration, fixed } from "../../ui/format";
import css from "./result.module.css";

/** What the answer rests on. */
export function Quality({ result, asked }: { result: CalibrationResult; asked: number }) {
  const { quality, provenance } = result;
  const used = quality.planes.length;
  // A run without an answer used nothing: its zeros would look like a perfect fit.
  const fit: [string, string][] = [
    ["Points used", count(quality.points_used)],
    ["Planes used", asked > 0 && asked !== used ? `${count(used)}, ${count(asked)} chosen` : count(used)],
    ["Points to planes, rms", `${fixed(quality.point_to_plane_rms_m * 1000, 2)} mm`],
  ];
  const facts: [string, string][] = [
    ...(quality.points_used > 0 ? fit : []),
    ["Scans used", `${count(quality.scans_used)} of ${count(quality.scans_total)}`],
    ...(result.T_imu_lidar === null ? [] : answered(result)),
    ["Solve alone took", duration(quality.duration_s)],
    ["Lidar", provenance.recording.lidar_topic],
    ["IMU", provenance.recording.imu_topic],
    ["Frames", `${provenance.recording.lidar_frame_id} to ${provenance.recording.imu_frame_id}`],
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

function answered(result: CalibrationResult): [string, string][] {
  return [
    ["Gravity", result.gravity_m_s2 === null ? "–" : `${fixed(result.gravity_m_s2, 4)} m/s²`],
    ["Gyroscope bias", vector(result.gyroscope_bias_rad_s, 1000, 3, "mrad/s")],
    ["Accelerometer bias", vector(result.accelerometer_bias_m_s2, 1000, 1, "mm/s²")],
    ["Iterations", count(result.quality.iterations)],
  ];
}

function vector(values: readonly number[] | null, factor: number, decimals: number, unit: string): string {
  return values === null ? "–" : `${values.map((value) => fixed(value * factor, decimals)).join("  ")} ${unit}`;
}
