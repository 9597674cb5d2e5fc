import { Button, Modal, SegmentedControl } from "@mantine/core";
import { useState } from "react";
import { Icon } from "../../ui/icons";
import css from "./guide.module.css";
import { MotionPicture } from "./motion";
import { guide, platforms, type Platform } from "./texts";

/** How to record so that the answer is good: pictures of the motion, for three kinds of rig. */
export function GuideDialog({ onClose }: { onClose: () => void }) {
  const [platform, setPlatform] = useState<Platform>("hand");
  const advice = guide[platform];
  return (
    <Modal opened onClose={onClose} size={760} title="How to record" closeButtonProps={{ "aria-label": "Close" }}>
      <div className={css.guide}>
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
        </ol>
        <p>{advice.limit}</p>
      </div>
    </Modal>
  );
}

/** Opens the guide from wherever it helps. */
export function GuideButton() {
  const [open, setOpen] = useState(false);
  return (
    <>
      <Button
        variant="default"
        leftSection={<Icon name="help" size={14} />}
        size="compact-md"
        onClick={() => setOpen(true)}
      >
        How to record
      </Button>
      {open && <GuideDialog onClose={() => setOpen(false)} />}
    </>
  );
}
