import { Button } from "@mantine/core";
import { Link, useNavigate } from "react-router";
import type { CalibrationResult, ChangeRecording, Recording } from "../../api/client";
import { useChangeRecording } from "../../api/queries";
import { GuideButton } from "../guide/dialog";
import { Icon } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import css from "./result.module.css";

interface Unit {
  label: string;
  change: ChangeRecording;
}

/** The unit that an answer's reasons cast doubt on, as the other one it could be; null where they speak of none. */
export function otherUnit(recording: Pick<Recording, "report" | "read_settings">, reasons: string): Unit | null {
  const imu = recording.report?.imu;
  if (/gyroscope/i.test(reasons) && /unit|times as fast/i.test(reasons)) {
    const now = recording.read_settings.gyroscope_unit ?? imu?.gyroscope_unit ?? "rad_s";
    return now === "rad_s"
      ? { label: "Read the gyroscope in °/s", change: { gyroscope_unit: "deg_s" } }
      : { label: "Read the gyroscope in rad/s", change: { gyroscope_unit: "rad_s" } };
  }
  if (/acceler|gravity/i.test(reasons) && /unit/i.test(reasons)) {
    const now = recording.read_settings.accelerometer_unit ?? imu?.accelerometer_unit ?? "m_s2";
    return now === "m_s2"
      ? { label: "Read accelerations in g", change: { accelerometer_unit: "g" } }
      : { label: "Read accelerations in m/s²", change: { accelerometer_unit: "m_s2" } };
  }
  return null;
}

/** What to do with an answer that is not one, or that something speaks against: the next step as buttons. */
export function NextSteps({ recording, result }: { recording: Recording; result: CalibrationResult }) {
  const navigate = useNavigate();
  const change = useChangeRecording(recording.id);
  const base = `/r/${recording.id}`;
  const reasons = result.messages
    .filter((message) => message.level !== "info")
    .map((message) => `${message.code} ${message.text}`)
    .join(" ");
  const unit = otherUnit(recording, reasons);
  const motions = result.observability.advice ?? [];
  return (
    <section aria-label="Next step" className={css.next}>
      <h2>What to do now</h2>
      <div className={css.nextButtons}>
        <Button
          component={Link}
          to={`${base}/planes`}
          variant="default"
          size="compact-md"
          leftSection={<Icon name="previous" size={13} />}
        >
          Back to the planes
        </Button>
        {unit !== null && (
          <Button
            variant="default"
            size="compact-md"
            loading={change.isPending}
            onClick={() => change.mutate(unit.change, { onSuccess: () => void navigate(`${base}/recording`) })}
          >
            {unit.label}
          </Button>
        )}
        <Button component={Link} to={`${base}/recording`} variant="default" size="compact-md">
          See how it was read
        </Button>
        <Button component={Link} to={`${base}/solve`} variant="default" size="compact-md">
          Solve with other settings
        </Button>
        <Button
          component={Link}
          to="/"
          variant="default"
          size="compact-md"
          leftSection={<Icon name="restart" size={13} />}
        >
          Open a new recording
        </Button>
        <GuideButton />
      </div>
      {motions.length === 0 && (
        <p className="dim small">
          If none of it helps, record again: stand still for two seconds, then turn briskly to and fro about all three
          axes for half a minute, 1 to 10 m from walls and floor.
        </p>
      )}
      {change.isError && <Fault error={change.error} />}
    </section>
  );
}
