import { NativeSelect, Skeleton } from "@mantine/core";
import type { ChangeRecording, DoctorReport, Recording } from "../../api/client";
import { useChangeRecording } from "../../api/changes";
import { count, duration, fixed } from "../../ui/format";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import css from "./recording.module.css";

type Fact = [name: string, value: string];

/** What was recognised of the two sensors; topics to choose from where several fit. */
export function Sensors({ recording }: { recording: Recording }) {
  const change = useChangeRecording(recording.id);
  const report = recording.report;
  if (report === null || report === undefined) {
    return recording.state === "failed" ? null : (
      <div role="status" aria-busy="true" aria-label="Sensors">
        <Skeleton height={120} mb={12} />
        <Skeleton height={120} />
      </div>
    );
  }
  const { lidar_topic: lidarWish, imu_topic: imuWish } = recording.read_settings;
  return (
    <>
      <Section title="Lidar">
        <TopicChoice
          label="Lidar topic"
          candidates={report.lidar_candidates}
          value={lidarWish ?? report.lidar?.topic ?? theOne(report.lidar_candidates)}
          onChoose={(topic) => change.mutate({ lidar_topic: topic })}
          disabled={change.isPending}
        />
        <Facts facts={lidarFacts(report)} report={report} of="lidar" />
      </Section>
      <Section title="IMU">
        <TopicChoice
          label="IMU topic"
          candidates={report.imu_candidates}
          value={imuWish ?? report.imu?.topic ?? theOne(report.imu_candidates)}
          onChoose={(topic) => change.mutate({ imu_topic: topic })}
          disabled={change.isPending}
        />
        <Facts facts={imuFacts(report)} report={report} of="imu" />
      </Section>
      {change.isError && <Fault error={change.error} />}
      <Section title="Topics">
        <ul className={css.topics}>
          {report.topics.map((topic) => (
            <li key={topic.name} title={topic.type}>
              <span className="clip">{topic.name}</span>
              <span className="num dim">{count(topic.messages)}</span>
              <span className="num dim">{rateText(topic.rate_hz)}</span>
            </li>
          ))}
        </ul>
      </Section>
    </>
  );
}

/** Whether a recording holds no such sensor at all, as far as that is known. */
function isMissing(report: DoctorReport, of: "lidar" | "imu"): boolean {
  return report.final && report[of] === null && report[`${of}_candidates`].length === 0;
}

/** Whether one of the two sensors is not there, without which nothing can be done with a recording. */
export function lacksSensor(report: DoctorReport | null | undefined): boolean {
  return report !== null && report !== undefined && (isMissing(report, "lidar") || isMissing(report, "imu"));
}

/** The choices without which nothing is known of the recording, and which only a person can make; none where all are made. */
export function openChoices(report: DoctorReport): { name: string; topic: string; change: ChangeRecording }[] {
  if (!report.final) return [];
  const of = (candidates: readonly string[], made: boolean) => (made || candidates.length < 2 ? [] : candidates);
  return [
    ...of(report.lidar_candidates, report.lidar !== null).map((topic) => ({
      name: "lidar",
      topic,
      change: { lidar_topic: topic },
    })),
    ...of(report.imu_candidates, report.imu !== null).map((topic) => ({
      name: "IMU",
      topic,
      change: { imu_topic: topic },
    })),
  ];
}

/** Where there is no choice, the topic is known before anything of it is. */
function theOne(candidates: readonly string[]): string | null {
  return candidates.length === 1 ? (candidates[0] ?? null) : null;
}

interface TopicChoiceProps {
  label: string;
  candidates: readonly string[];
  value: string | null;
  onChoose: (topic: string) => void;
  disabled: boolean;
}

function TopicChoice({ label, candidates, value, onChoose, disabled }: TopicChoiceProps) {
  if (candidates.length < 2) return value === null ? null : <p className={`num ${css.topic ?? ""}`}>{value}</p>;
  return (
    <NativeSelect
      size="xs"
      mb={6}
      label={label}
      data={[...(value === null ? [{ value: "", label: `Choose among ${candidates.length}` }] : []), ...candidates]}
      value={value ?? ""}
      disabled={disabled}
      onChange={(event) => {
        const topic = event.currentTarget.value;
        if (topic !== "" && topic !== value) onChoose(topic);
      }}
    />
  );
}

/** What was found of a sensor; that it is still being looked for, or that there is none. */
function Facts({ facts, report, of }: { facts: readonly Fact[]; report: DoctorReport; of: "lidar" | "imu" }) {
  if (report[of] === null) {
    if (!report.final) return <Skeleton height={120} />;
    if (isMissing(report, of)) return <p className="dim small">There is none in this recording.</p>;
  }
  return (
    <dl className={css.facts}>
      {facts.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd className="clip" title={value}>
            {value}
          </dd>
        </div>
      ))}
    </dl>
  );
}

/** How many there are, and how often they come where that is known: one alone has no rate. */
export function manyAt(many: number, rateHz: number): string {
  const rate = rateText(rateHz);
  return rate === "" ? count(many) : `${count(many)} at ${rate}`;
}

/** The rate of a topic, the same wherever it stands; nothing until it is known. */
export function rateText(rateHz: number): string {
  return rateHz > 0 ? `${fixed(rateHz, rateHz < 95 ? 1 : 0)} Hz` : "";
}

function lidarFacts({ lidar, findings }: DoctorReport): Fact[] {
  if (lidar === null) return [];
  const time = lidar.point_time;
  const ranges = lidar.ranges;
  const madeUp = findings.some((finding) => finding.code === "points.time_synthesised");
  const atOnce = findings.some((finding) => finding.code === "points.at_once");
  return [
    ["Sensor", lidar.preset.identified ? lidar.preset.name : `not recognised (as ${lidar.preset.name})`],
    ["Scans", manyAt(lidar.scans, lidar.stamps.rate_hz)],
    ["Points a scan", ranges === null ? "–" : count(ranges.points_per_scan)],
    [
      "Point time",
      time === null ? (madeUp ? "made up" : atOnce ? "all at once" : "none") : `${time.field}, ${time.unit}`,
    ],
    ["Range noise", rangeNoise(lidar)],
    ["Ranges", ranges === null ? "–" : `${fixed(ranges.p05_m, 1)} to ${fixed(ranges.p95_m, 1)} m`],
  ];
}

function rangeNoise(lidar: NonNullable<DoctorReport["lidar"]>): string {
  const measured = lidar.measured_range_std_m;
  if (measured === null || measured === undefined) return `${fixed(lidar.preset.range_std_m * 1000, 0)} mm, preset`;
  return `${fixed(measured * 1000, 1)} mm, measured on planes`;
}

export function noiseOrigin(imu: NonNullable<DoctorReport["imu"]>): string {
  switch (imu.noise_used) {
    case "measured":
      return `measured in ${duration(imu.measured_noise?.static_s ?? 0)} of standstill`;
    case "moving":
      return "measured in motion";
    case "preset":
      return `preset ${imu.preset_noise.origin}`;
  }
}

function imuFacts({ imu }: DoctorReport): Fact[] {
  if (imu === null) return [];
  const noise = imu.measured_noise ?? imu.preset_noise;
  const gyroDeg = (noise.noise.gyroscope_noise_density_rad_s_sqrt_hz * 180) / Math.PI;
  const accelUg = (noise.noise.accelerometer_noise_density_m_s2_sqrt_hz / 9.80665) * 1e6;
  return [
    ["Readings", manyAt(imu.readings, imu.stamps.rate_hz)],
    ["Units", `${imu.accelerometer_unit.replace("m_s2", "m/s²")}, ${imu.gyroscope_unit.replace("_", "/")}`],
    [imu.still_spans.length > 0 ? "At rest" : "Never at rest", `${fixed(imu.gravity_at_rest_m_s2, 2)} m/s²`],
    ["Noise", noiseOrigin(imu)],
    ["Gyroscope", `${fixed(gyroDeg, 4)} °/s/√Hz`],
    ["Accelerometer", `${fixed(accelUg, 0)} µg/√Hz`],
  ];
}
