import { Tooltip } from "@mantine/core";
import { Fragment } from "react";
import { Link } from "react-router";
import { Icon } from "./icons";
import css from "./shell.module.css";

export type StepName = "recording" | "planes" | "solve" | "inspect" | "result";
export type StepState = "open" | "busy" | "done" | "locked";

export interface Step {
  name: StepName;
  state: StepState;
  /** Where it leads; undefined while there is no recording. */
  to?: string;
  /** Why it cannot be entered yet. */
  reason?: string;
}

const titles: Record<StepName, string> = {
  recording: "Recording",
  planes: "Planes",
  solve: "Solve",
  inspect: "Inspect",
  result: "Result",
};

/** The five steps of the work, left to right. */
export function Stepper({ steps, current }: { steps: readonly Step[]; current: StepName | null }) {
  return (
    <nav aria-label="Steps" className={css.steps}>
      {steps.map((step, index) => (
        <Fragment key={step.name}>
          {index > 0 && <span className={css.joint} aria-hidden="true" />}
          <StepItem step={step} number={index + 1} isCurrent={step.name === current} />
        </Fragment>
      ))}
    </nav>
  );
}

function StepItem({ step, number, isCurrent }: { step: Step; number: number; isCurrent: boolean }) {
  const content = (
    <>
      <span className={css.badge} aria-hidden="true">
        {step.state === "done" && !isCurrent ? <Icon name="check" size={12} /> : step.state === "busy" ? "" : number}
      </span>
      <span className={css.stepName}>
        {titles[step.name]}
        {step.state === "done" && <span className="sr-only"> (done)</span>}
      </span>
    </>
  );
  if (step.to === undefined || step.state === "locked") {
    return (
      <Tooltip label={step.reason ?? "Open a recording first"} openDelay={300}>
        <span
          className={css.step}
          data-locked="true"
          data-state={step.state}
          aria-current={isCurrent ? "step" : undefined}
        >
          {content}
        </span>
      </Tooltip>
    );
  }
  return (
    <Link className={css.step} to={step.to} data-state={step.state} aria-current={isCurrent ? "step" : undefined}>
      {content}
    </Link>
  );
}
