import { Button, FileButton, SegmentedControl, Textarea } from "@mantine/core";
import { useState } from "react";
import type { ExtrinsicText, OldExtrinsic, View } from "../../api/client";
import { useReadExtrinsic } from "../../api/changes";
import { fixed } from "../../ui/format";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import { nameOfOld } from "./oldtext";
import css from "./inspect.module.css";

interface OldSectionProps {
  recordingId: string;
  old: OldExtrinsic | null;
  blur: View["old_blur"];
  onChange: (old: OldExtrinsic | null) => void;
}

type Direction = ExtrinsicText["direction"];

/** The extrinsic used so far, pasted or uploaded, to be seen beside the answer. */
export function OldSection({ recordingId, old, blur, onChange }: OldSectionProps) {
  return (
    <Section
      title={nameOfOld(old, "Your old extrinsic")}
      tools={
        old !== null && (
          <Button size="compact-xs" variant="default" onClick={() => onChange(null)}>
            Remove
          </Button>
        )
      }
    >
      {old === null ? <OldForm recordingId={recordingId} onRead={onChange} /> : <OldFacts old={old} blur={blur} />}
    </Section>
  );
}

function OldFacts({ old, blur }: { old: OldExtrinsic; blur: View["old_blur"] }) {
  return (
    <>
      <p className={css.blur} role="status">
        {blur === null || blur === undefined ? (
          "Measuring the walls with it…"
        ) : (
          <>
            Walls <strong className="num">{fixed(blur.nudged_rms_m * 1000, 1)} mm</strong> thick with it,{" "}
            <span className="num">{fixed(blur.solved_rms_m * 1000, 1)} mm</span> with the answer.
          </>
        )}
      </p>
      <p className="small dim">
        Lidar at <span className="num">{old.translation_m.map((value) => fixed(value * 1000, 0)).join(", ")}</span> mm
        in the IMU&rsquo;s frame;{" "}
        {old.time_offset_s === null || old.time_offset_s === undefined
          ? "it names no time offset, so the answer's is used."
          : `time offset ${fixed(old.time_offset_s * 1000, 2)} ms.`}
      </p>
    </>
  );
}

function OldForm({ recordingId, onRead }: { recordingId: string; onRead: (old: OldExtrinsic) => void }) {
  const [text, setText] = useState("");
  const [direction, setDirection] = useState<Direction>("imu_lidar");
  const read = useReadExtrinsic(recordingId);
  const show = (what: string) => read.mutate({ text: what, direction }, { onSuccess: (old) => onRead(old) });
  const upload = (file: File | null) => {
    if (file !== null) void file.text().then(show);
  };
  return (
    <div className={css.form}>
      <Textarea
        size="xs"
        label="Paste it: our JSON, a URDF, a 4 × 4 matrix, or x y z and a quaternion x y z w"
        placeholder={"0.10 -0.12 0.08  0 0 0.71 0.71"}
        minRows={2}
        maxRows={5}
        autosize
        value={text}
        onChange={(event) => setText(event.currentTarget.value)}
      />
      <SegmentedControl
        size="xs"
        fullWidth
        aria-label="Which way it leads"
        value={direction}
        onChange={(value) => setDirection(value === "lidar_imu" ? "lidar_imu" : "imu_lidar")}
        data={[
          { value: "imu_lidar", label: "lidar → IMU" },
          { value: "lidar_imu", label: "IMU → lidar" },
        ]}
      />
      <div className={css.row}>
        <Button
          size="compact-sm"
          variant="default"
          disabled={text.trim() === ""}
          loading={read.isPending}
          onClick={() => show(text)}
        >
          Show it
        </Button>
        <FileButton
          accept=".json,.txt,.yaml,.tum,.urdf,.xml,text/*,application/json"
          onChange={upload}
          inputProps={{ "aria-label": "A file with your old extrinsic" }}
        >
          {(props) => (
            <Button size="compact-sm" variant="subtle" {...props}>
              From a file…
            </Button>
          )}
        </FileButton>
      </div>
      {read.isError && <Fault error={read.error} />}
    </div>
  );
}
