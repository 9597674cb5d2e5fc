import { Button, FileButton, SegmentedControl, Textarea, TextInput } from "@mantine/core";
import type { NewAudit } from "../../api/client";
import { Section } from "../../ui/panel";
import css from "./audit.module.css";
import type { LimitsText } from "./limits";

export interface AuditDraft {
  text: string;
  /** Of the file it came from; "" for what was pasted. */
  file: string;
  direction: NonNullable<NewAudit["direction"]>;
  limits: LimitsText;
}

interface AuditFormProps {
  draft: AuditDraft;
  onChange: (part: Partial<AuditDraft>) => void;
  limitsFit: boolean;
}

/** The extrinsic in use, as it stands in a file, and how far off it may be. */
export function AuditForm({ draft, onChange, limitsFit }: AuditFormProps) {
  const upload = (file: File | null) => {
    if (file !== null) void file.text().then((text) => onChange({ text, file: file.name }));
  };
  const limit = (name: keyof LimitsText, label: string) => (
    <TextInput
      size="xs"
      inputMode="decimal"
      label={label}
      placeholder="not judged"
      value={draft.limits[name]}
      onChange={(event) => onChange({ limits: { ...draft.limits, [name]: event.currentTarget.value } })}
    />
  );
  return (
    <>
      <Section
        title="The extrinsic in use"
        tools={
          <FileButton
            accept=".json,.yaml,.yml,.urdf,.xacro,.xml,.txt,.tum,text/*,application/json"
            onChange={upload}
            inputProps={{ "aria-label": "A file with the extrinsic" }}
          >
            {(props) => (
              <Button size="compact-xs" variant="default" {...props}>
                From a file…
              </Button>
            )}
          </FileButton>
        }
      >
        <div className={css.form}>
          <Textarea
            size="xs"
            aria-label="The extrinsic in use"
            description={
              draft.file === ""
                ? "Paste our JSON, a URDF, the settings of FAST-LIO or LIO-SAM, or a 4 × 4 matrix"
                : `From ${draft.file}`
            }
            placeholder={"1 0 0 0.10\n0 1 0 -0.12\n0 0 1 0.08\n0 0 0 1"}
            rows={6}
            classNames={{ input: css.paste ?? "" }}
            value={draft.text}
            onChange={(event) => onChange({ text: event.currentTarget.value, file: "" })}
          />
          <div className={css.direction}>
            <span className="small dim">Bare numbers lead from</span>
            <SegmentedControl
              size="xs"
              aria-label="Which way bare numbers lead"
              value={draft.direction}
              onChange={(value) => onChange({ direction: value === "lidar_imu" ? "lidar_imu" : "imu_lidar" })}
              data={[
                { value: "imu_lidar", label: "lidar to IMU" },
                { value: "lidar_imu", label: "IMU to lidar" },
              ]}
            />
          </div>
        </div>
      </Section>
      <Section title="How far off it may be">
        <div className={css.limits}>
          {limit("rotation", "Turn, °")}
          {limit("translation", "Position, mm")}
          {limit("time", "Time offset, ms")}
        </div>
        <p className={limitsFit ? "dim small" : css.wrong} role={limitsFit ? undefined : "alert"}>
          {limitsFit
            ? "One number for all axes, or three for x y z. What is left empty is not judged."
            : "Give one number above zero, or three for x y z, in at least one of the fields."}
        </p>
      </Section>
    </>
  );
}
