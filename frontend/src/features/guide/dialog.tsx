import { Button, Modal, SegmentedControl } from "@mantine/core";
import { useState } from "react";
import { Link } from "react-router";
import { Icon } from "../../ui/icons";
import css from "./guide.module.css";
import { MotionPicture } from "./motion";
import { guide, platforms, pointTimes, type Platform } from "./texts";

interface GuideDialogProps {
  asked?: readonly string[];
  /** Opened from an answer that asks for another recording, which is the next thing to open. */
  again?: boolean;
  onClose: () => void;
}

/** How to record so that the answer is good: pictures of the motion, for three kinds of rig. */
export function GuideDialog({ asked = [], again = false, onClose }: GuideDialogProps) {
  const [platform, setPlatform] = useState<Platform>("hand");
  const advice = guide[platform];
  return (
    <Modal opened onClose={onClose} size={760} title="How to record" closeButtonProps={{ "aria-label": "Close" }}>
      <div className={css.guide}>
        {asked.length > 0 && (
          <section className={css.asked} aria-label="What this recording lacked">
            <strong>What this recording lacked</strong>
            {asked.map((sentence) => (
              <p key={sentence}>{sentence}</p>
            ))}
          </section>
        )}
        <SegmentedControl
          aria-label="What carries the sensors"
          value={platform}
          onChange={(value) => setPlatform(platforms.find((one) => one === value) ?? "hand")}
          data={platforms.map((one) => ({ value: one, label: guide[one].label }))}
        />
        <div className={css.pictures}>
          <MotionPicture platform={platform} good text={advice.good} />
          <MotionPicture platform={platform} good={false} text={advice.bad} />
        </div>
        <p className="dim small">
          The curves are the rate of turn about x, y and z over time, as the Recording screen shows it: still first,
          then all three busy.
        </p>
        <ol className={css.steps}>
          {advice.steps.map((step) => (
            <li key={step}>{step}</li>
          ))}
          <li>{pointTimes}</li>
        </ol>
        <p>{advice.limit}</p>
        {again && (
          <Button component={Link} to="/" className={css.onward ?? ""} size="compact-md" onClick={onClose}>
            Open the new recording
          </Button>
        )}
      </div>
    </Modal>
  );
}

interface GuideButtonProps {
  label?: string;
  /** Motions that an earlier recording asks for. */
  asked?: readonly string[];
  variant?: "default" | "filled";
}

/** Opens the guide from wherever it helps. */
export function GuideButton({ label = "How to record", asked = [], variant = "default" }: GuideButtonProps) {
  const [open, setOpen] = useState(false);
  return (
    <>
      <Button
        variant={variant}
        leftSection={<Icon name="help" size={14} />}
        size="compact-md"
        onClick={() => setOpen(true)}
      >
        {label}
      </Button>
      {open && <GuideDialog asked={asked} again={label !== "How to record"} onClose={() => setOpen(false)} />}
    </>
  );
}
