import { Button, NativeSelect, Switch, TextInput } from "@mantine/core";
import { useEffect, useId, useRef, useState, type ReactNode } from "react";
import { useLocation } from "react-router";
import type { ChangeRecording, DoctorReport, Recording } from "../../api/client";
import { useChangeRecording } from "../../api/changes";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import { controlName, valueName } from "../../ui/words";
import css from "./recording.module.css";

type Choice =
  | "point_time_unit"
  | "point_time_reference"
  | "accelerometer_unit"
  | "gyroscope_unit"
  | "stamps"
  | "imu_bundles"
  | "repeated_returns";

const units: Record<Choice, readonly string[]> = {
  point_time_reference: ["header-first", "header-last", "absolute"],
  point_time_unit: ["s", "ms", "us", "ns"],
  accelerometer_unit: ["m_s2", "g"],
  gyroscope_unit: ["rad_s", "deg_s"],
  stamps: ["header", "receive"],
  imu_bundles: ["spread", "as-stamped"],
  repeated_returns: ["once", "as-sent"],
};

/** Those with more words than half of the panel has room for. */
const wide: ReadonlySet<Choice> = new Set(["point_time_reference", "imu_bundles", "repeated_returns"]);

/** Always one of its values: nothing is detected. */
const isGiven = (key: Choice) => key === "stamps" || key === "imu_bundles" || key === "repeated_returns";

const label = (key: string) => controlName(key.replaceAll("_", "-"));

/** Where this is on its page, for those who are sent there. */
export const readingPlace = "reading";

/** Everything that is recognised of a recording, to be said otherwise: each a control, none needed where all is right. */
export function Reading({ recording }: { recording: Recording }) {
  const change = useChangeRecording(recording.id);
  const settings = recording.read_settings;
  const apply = (part: ChangeRecording) => change.mutate(part);
  const told = Object.entries(settings).some(([key, value]) => changedByHand(key, value));
  // At the end of a long column the controls come up below its fold, and who asked for them would see nothing happen.
  const box = useRef<HTMLDetailsElement>(null);
  const asked = useRef(false);
  const show = () => {
    box.current?.scrollIntoView({ block: "start", behavior: "smooth" });
    box.current?.querySelector("select")?.focus({ preventScroll: true });
  };
  const sent = useLocation().hash === `#${readingPlace}`;
  useEffect(() => {
    if (sent) show();
  }, [sent]);
  return (
    <Section title="How it is read">
      <details
        ref={box}
        className={css.reading}
        open={recording.state === "failed" || told || sent}
        onToggle={() => {
          if (asked.current) show();
          asked.current = false;
        }}
      >
        <summary
          onClick={() => {
            asked.current = box.current?.open === false;
          }}
        >
          Correct what was recognised
        </summary>
        <div className={css.readingGrid}>
          {(Object.keys(units) as Choice[]).map((key) => (
            <NativeSelect
              key={key}
              size="xs"
              className={wide.has(key) ? (css.wide ?? "") : ""}
              label={label(key)}
              disabled={change.isPending}
              value={settings[key] ?? ""}
              data={[
                ...(isGiven(key) ? [] : [{ value: "", label: detected(recording.report, key) }]),
                ...units[key].map((value) => ({ value, label: valueName(value) })),
              ]}
              onChange={(event) => {
                const { value } = event.currentTarget;
                apply({ [key]: value === "" ? null : value });
              }}
            />
          ))}
          <TextChoice
            key={`field ${settings.point_time_field ?? ""}`}
            label={label("point_time_field")}
            placeholder={recording.report?.lidar?.point_time?.field ?? "as found"}
            value={settings.point_time_field ?? ""}
            disabled={change.isPending}
            onSet={(value) => apply({ point_time_field: value === "" ? null : value })}
          />
          <NumberChoice
            label={`${label("range_min_m")}, m`}
            value={settings.range_min_m}
            disabled={change.isPending}
            onSet={(range_min_m) => apply({ range_min_m })}
          />
          <NumberChoice
            label={`${label("range_max_m")}, m`}
            value={settings.range_max_m}
            disabled={change.isPending}
            onSet={(range_max_m) => apply({ range_max_m })}
          />
        </div>
        <Explained text="For clouds without a time for each point: times are made up from the order of the points, which costs accuracy.">
          {(id) => (
            <Switch
              size="xs"
              label={label("synthesise_point_time")}
              aria-describedby={id}
              checked={settings.synthesise_point_time}
              disabled={change.isPending}
              onChange={(event) => apply({ synthesise_point_time: event.currentTarget.checked })}
            />
          )}
        </Explained>
        <Explained text="For flash lidars and depth cameras: all points of a cloud were taken at its stamp.">
          {(id) => (
            <Switch
              size="xs"
              label={label("points_at_once")}
              aria-describedby={id}
              checked={settings.points_at_once}
              disabled={change.isPending}
              onChange={(event) => apply({ points_at_once: event.currentTarget.checked })}
            />
          )}
        </Explained>
        {told && (
          <Button size="compact-xs" variant="default" loading={change.isPending} onClick={() => apply(asFound)}>
            As it was recognised
          </Button>
        )}
      </details>
      {change.isError && <Fault error={change.error} />}
    </Section>
  );
}

/** Null means: detect it again. */
const asFound: ChangeRecording = {
  point_time_field: null,
  point_time_unit: null,
  point_time_reference: null,
  synthesise_point_time: false,
  points_at_once: false,
  accelerometer_unit: null,
  gyroscope_unit: null,
  stamps: "header",
  imu_bundles: "spread",
  repeated_returns: "once",
};

function changedByHand(key: string, value: unknown): boolean {
  if (!(key in asFound)) return false;
  return value !== null && value !== (asFound as Record<string, unknown>)[key];
}

/** What is used as long as nobody says otherwise. */
function detected(report: DoctorReport | null | undefined, key: Choice): string {
  const found = {
    point_time_unit: report?.lidar?.point_time?.unit,
    point_time_reference: report?.lidar?.point_time?.reference,
    accelerometer_unit: report?.imu?.accelerometer_unit,
    gyroscope_unit: report?.imu?.gyroscope_unit,
    stamps: undefined,
    imu_bundles: undefined,
    repeated_returns: undefined,
  }[key];
  return found === undefined ? "as found" : `as found: ${valueName(found)}`;
}

function Explained({ text, children }: { text: string; children: (id: string) => ReactNode }) {
  const id = useId();
  return (
    <div className={css.explained}>
      {children(id)}
      <p id={id} className="dim small">
        {text}
      </p>
    </div>
  );
}

interface TextChoiceProps {
  label: string;
  value: string;
  placeholder?: string;
  disabled: boolean;
  onSet: (value: string) => void;
}

/** Text that counts once it is finished: each change reads the recording anew. */
function TextChoice({ label: name, value, placeholder, disabled, onSet }: TextChoiceProps) {
  const [text, setText] = useState(value);
  const done = () => {
    if (text.trim() !== value) onSet(text.trim());
  };
  return (
    <TextInput
      size="xs"
      label={name}
      value={text}
      {...(placeholder === undefined ? {} : { placeholder })}
      disabled={disabled}
      onChange={(event) => setText(event.currentTarget.value)}
      onBlur={done}
      onKeyDown={(event) => {
        if (event.key === "Enter") done();
      }}
    />
  );
}

function NumberChoice({
  label: name,
  value,
  disabled,
  onSet,
}: {
  label: string;
  value: number;
  disabled: boolean;
  onSet: (value: number) => void;
}) {
  return (
    <TextChoice
      key={value}
      label={name}
      value={String(value)}
      disabled={disabled}
      onSet={(text) => {
        const wanted = Number(text.replace(",", "."));
        if (text !== "" && Number.isFinite(wanted) && wanted !== value) onSet(wanted);
      }}
    />
  );
}
