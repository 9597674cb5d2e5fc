import { ActionIcon, Button } from "@mantine/core";
import type { View } from "../../api/client";
import { fixed } from "../../ui/format";
import { Section } from "../../ui/panel";
import css from "./inspect.module.css";
import { noNudge, nudgeAxes, stepped, wallsAreSilent, writeNudge, type Nudge } from "./nudges";

interface NudgeSectionProps {
  nudge: Nudge;
  blur: View["blur"];
  onChange: (nudge: Nudge) => void;
}

/** Makes the answer wrong on purpose: by a degree, a centimetre, a millisecond. */
export function NudgeSection({ nudge, blur, onChange }: NudgeSectionProps) {
  const nudged = writeNudge(nudge) !== "";
  return (
    <Section
      title="What if it were wrong?"
      tools={
        <Button size="compact-xs" variant="default" disabled={!nudged} onClick={() => onChange(noNudge)}>
          Back to the answer
        </Button>
      }
    >
      <p className={css.blur} role="status">
        {nudged && blur !== null && blur !== undefined ? (
          <>
            Walls <span className="num">{fixed(blur.solved_rms_m * 1000, 1)}</span> mm thick as solved,{" "}
            <strong className="num">{fixed(blur.nudged_rms_m * 1000, 1)} mm</strong> with this error.
            {wallsAreSilent(nudge, blur) && " Walls hardly show a shift; the accelerations tell it."}
          </>
        ) : nudged ? (
          "Working out what this error costs…"
        ) : (
          "Step an axis and watch the walls blur."
        )}
      </p>
      <ul className={css.nudges}>
        {nudgeAxes.map((axis) => {
          const value = nudge[axis.key];
          return (
            <li key={axis.key} data-changed={value !== 0}>
              <span>{axis.label}</span>
              <ActionIcon
                size="sm"
                variant="default"
                aria-label={`${axis.label}: less`}
                onClick={() => onChange(stepped(nudge, axis, -1))}
              >
                −
              </ActionIcon>
              <span className="num">
                {value > 0 ? "+" : ""}
                {fixed(value * axis.factor, 0)}
              </span>
              <ActionIcon
                size="sm"
                variant="default"
                aria-label={`${axis.label}: more`}
                onClick={() => onChange(stepped(nudge, axis, 1))}
              >
                +
              </ActionIcon>
              <span className="dim">{axis.unit}</span>
            </li>
          );
        })}
      </ul>
    </Section>
  );
}
