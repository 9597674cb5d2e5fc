import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Fragment, type ReactNode } from "react";
import { Link, useNavigate } from "react-router";
import type { CalibrationResult, ChangeRecording, Recording, Run } from "../../api/client";
import { useChangeRecording } from "../../api/changes";
import { planesQuery } from "../../api/planes";
import { factsQuery } from "../../api/queries";
import {
  accelerometerUnitDoubted,
  contradictedPrior,
  gyroscopeUnitDoubted,
  ofAccelerometer,
  ofGyroscope,
} from "../../api/sentences";
import { LeaveOut } from "./culprits";
import { GuideButton } from "../guide/dialog";
import { Icon } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import type { Axis } from "../../ui/axes";
import { readingPlace } from "../recording/reading";
import css from "./result.module.css";

interface Unit {
  label: string;
  change: ChangeRecording;
}

/** The unit that an answer's gravest reasons cast doubt on, as the other one it could be; null where they speak of none. Each is
 *  judged by its own words. */
export function otherUnit(
  recording: Pick<Recording, "report" | "read_settings">,
  reasons: readonly string[],
): Unit | null {
  const imu = recording.report?.imu;
  const doubted = (sensor: RegExp, doubt: RegExp) => reasons.some((text) => sensor.test(text) && doubt.test(text));
  if (doubted(ofGyroscope, gyroscopeUnitDoubted)) {
    const now = recording.read_settings.gyroscope_unit ?? imu?.gyroscope_unit ?? "rad_s";
    return now === "rad_s"
      ? { label: "Read the gyroscope in °/s", change: { gyroscope_unit: "deg_s" } }
      : { label: "Read the gyroscope in rad/s", change: { gyroscope_unit: "rad_s" } };
  }
  if (doubted(ofAccelerometer, accelerometerUnitDoubted)) {
    const now = recording.read_settings.accelerometer_unit ?? imu?.accelerometer_unit ?? "m_s2";
    return now === "m_s2"
      ? { label: "Read accelerations in g", change: { accelerometer_unit: "g" } }
      : { label: "Read accelerations in m/s²", change: { accelerometer_unit: "m_s2" } };
  }
  return null;
}

export type Step = "record" | "measure" | "unit" | "reading" | "planes" | "settings";

/** How many of the planes that were found a solve did without, where these and no others would have it face three ways. */
export function missedPlanes(
  used: readonly { normal: readonly number[] }[],
  found: readonly { normal: readonly number[] }[],
): number {
  return faceThreeWays(used) || !faceThreeWays(found) ? 0 : Math.max(0, found.length - used.length);
}

/** The volume that three normals span, least for planes that face three ways: they stand some 17 degrees out of a common plane. */
const threeWays = 0.3;

function faceThreeWays(planes: readonly { normal: readonly number[] }[]): boolean {
  const normals = planes.map(({ normal: [x = 0, y = 0, z = 0] }) => [x, y, z] as const);
  return normals.some((a, i) =>
    normals
      .slice(i + 1)
      .some((b, j) =>
        normals
          .slice(i + j + 2)
          .some(
            (c) =>
              Math.abs(
                a[0] * (b[1] * c[2] - b[2] * c[1]) +
                  a[1] * (b[2] * c[0] - b[0] * c[2]) +
                  a[2] * (b[0] * c[1] - b[1] * c[0]),
              ) > threeWays,
          ),
      ),
  );
}

/** What helps most, by what the run said; null where nothing stands out.
 *
 *  missed: planes that were found and not used, and without which the others do not face three ways. */
export function firstStep(
  status: CalibrationResult["status"],
  codes: readonly string[],
  unit: Unit | null,
  missed = 0,
): Step | null {
  const about = (...starts: string[]) => codes.some((code) => starts.some((start) => code.startsWith(start)));
  if (unit !== null && about("imu.gyroscope_unit", "imu.accelerometer_unit")) return "unit";
  if (about("imu.axis_signs", "points.")) return "reading";
  if (about("prior.", "start.guess")) return "settings"; // what was given has to be corrected
  if (status === "weak" && missed > 0) return "planes";
  if (status === "weak" || about("motion.", "start.too_short")) return "record";
  if (about("planes.doubted")) return null; // it has a button of its own
  if (about("planes.", "solve.", "start.", "paper.")) return "planes";
  return null;
}

/** Which of the axes that something was given for the recording contradicts, by what is said of it; the first where that is not
 *  clear, null where nothing was given. */
export function contradicted(texts: readonly string[], given: readonly Axis[]): Axis | null {
  const said = texts.map((text) => contradictedPrior.exec(text)).find((found) => found !== null);
  const axis =
    said === undefined ? null : said[1] === undefined ? "dt" : `${said[1] === "rotation" ? "r" : "t"}${said[2] ?? ""}`;
  return given.find((one) => one === axis) ?? given[0] ?? null;
}

const positions = ["tx", "ty", "tz"] as const;

/** The position that a tape measure would help most: of a weak answer the one least known, where it is beyond the limit [m]. */
export function toMeasure(
  { status, uncertainty }: Pick<CalibrationResult, "status" | "uncertainty">,
  limitM: number,
): Axis | null {
  if (status !== "weak" || uncertainty === null) return null;
  const stds = uncertainty.translation_std_m;
  const most = Math.max(...stds);
  return most > limitM ? (positions[stds.indexOf(most)] ?? null) : null;
}

interface NextStepsProps {
  recording: Recording;
  run: Run;
  result: CalibrationResult;
}

/** What to do with an answer that is not one, or that something speaks against: the next step as buttons. */
export function NextSteps({ recording, run, result }: NextStepsProps) {
  const navigate = useNavigate();
  const change = useChangeRecording(recording.id);
  const base = `/r/${recording.id}`;
  const motions = result.observability.advice ?? [];
  const gravest = result.messages.filter(
    (message) => message.level === (result.status === "refused" ? "error" : "warning"),
  );
  const unit = otherUnit(
    recording,
    gravest.map((message) => message.text),
  );
  const found = useQuery({ ...planesQuery(recording.id), enabled: recording.has_planes }).data?.patches ?? [];
  const missed = missedPlanes(result.quality.planes, found);
  const first = firstStep(
    result.status,
    gravest.map((message) => message.code),
    unit,
    missed,
  );
  const known = contradicted(
    gravest.filter(({ code }) => code.startsWith("prior.")).map(({ text }) => text),
    run.job.settings.priors.map(({ axis }) => axis),
  );
  const solve = new URLSearchParams({ job: run.job.id, ...(first === "settings" && known !== null ? { known } : {}) });
  const measure = toMeasure(result, useQuery(factsQuery).data?.limits.translation_m ?? Infinity);
  const look = (step: Step) =>
    ({ size: "compact-md", variant: step === first ? "filled" : "default", "data-first": step === first }) as const;
  const steps: Record<Step, ReactNode> = {
    record: <GuideButton label="Record again with this motion" asked={motions} variant={look("record").variant} />,
    measure: measure !== null && (
      <Button
        component={Link}
        to={`${base}/solve?${new URLSearchParams({ job: run.job.id, known: measure }).toString()}`}
        {...look("measure")}
      >
        Give position {measure.slice(1)} by tape measure
      </Button>
    ),
    unit: unit !== null && (
      <Button
        {...look("unit")}
        loading={change.isPending}
        onClick={() => change.mutate(unit.change, { onSuccess: () => void navigate(`${base}/recording`) })}
      >
        {unit.label}
      </Button>
    ),
    reading: (
      <Button component={Link} to={`${base}/recording#${readingPlace}`} {...look("reading")}>
        See how it was read
      </Button>
    ),
    planes: (
      <Button
        component={Link}
        to={`${base}/planes`}
        {...look("planes")}
        leftSection={<Icon name="previous" size={13} />}
      >
        {missed > 0 ? `Back to the planes: ${missed} of ${found.length} were left out` : "Back to the planes"}
      </Button>
    ),
    settings: (
      <Button component={Link} to={`${base}/solve?${solve.toString()}`} {...look("settings")}>
        Solve with other settings
      </Button>
    ),
  };
  const order = (["unit", "planes", "record", "measure", "reading", "settings"] as const).toSorted(
    (a, b) => Number(b === first) - Number(a === first),
  );
  return (
    <section aria-label="Next step" className={css.next}>
      <h2>What to do now</h2>
      <div className={css.nextButtons}>
        <LeaveOut recording={recording} run={run} result={result} />
        {order.map((step) => (
          <Fragment key={step}>{steps[step]}</Fragment>
        ))}
      </div>
      {change.isError && <Fault error={change.error} />}
    </section>
  );
}
