import { Button, Textarea } from "@mantine/core";
import { useState } from "react";
import type { NewJob, OldExtrinsic } from "../../api/client";
import { useReadExtrinsic } from "../../api/changes";
import { fixed } from "../../ui/format";
import { Fault } from "../../ui/notice";
import { matrixOf } from "./guess";
import css from "./solve.module.css";

export type Guess = NonNullable<NewJob["initial_guess"]>;

interface StartValueProps {
  recordingId: string;
  guess: OldExtrinsic | null;
  onChange: (guess: OldExtrinsic | null) => void;
}

/** The request's start value behind what was read. */
export function guessOf(read: OldExtrinsic): Guess {
  return { matrix: matrixOf(read), time_offset_s: read.time_offset_s ?? null };
}

/** Where the solve starts, for rigs that leave it in doubt; nobody has to give one. */
export function StartValue({ recordingId, guess, onChange }: StartValueProps) {
  const [text, setText] = useState("");
  const read = useReadExtrinsic(recordingId);
  if (guess !== null) {
    return (
      <div className={css.option}>
        <span className="small">
          Starts with the lidar at{" "}
          <span className="num">{guess.translation_m.map((value) => fixed(value * 1000, 0)).join(", ")}</span> mm in the
          IMU&rsquo;s frame
        </span>
        <Button size="compact-xs" variant="default" onClick={() => onChange(null)}>
          Without
        </Button>
      </div>
    );
  }
  return (
    <div className={css.guess}>
      <Textarea
        size="xs"
        label="Start value"
        description="Found from the recording where left empty. Our JSON, a URDF, a 4 × 4 matrix, or x y z and a quaternion x y z w"
        minRows={1}
        maxRows={5}
        autosize
        value={text}
        onChange={(event) => setText(event.currentTarget.value)}
      />
      {text.trim() !== "" && (
        <Button
          size="compact-xs"
          variant="default"
          loading={read.isPending}
          onClick={() => read.mutate({ text, direction: "imu_lidar" }, { onSuccess: onChange })}
        >
          Start there
        </Button>
      )}
      {read.isError && <Fault error={read.error} />}
    </div>
  );
}
