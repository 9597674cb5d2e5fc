import { ActionIcon, Tooltip, useComputedColorScheme, useMantineColorScheme } from "@mantine/core";
import { useState, type ReactNode } from "react";
import { Link, useNavigate } from "react-router";
import { HelpDialog } from "./help";
import { Icon } from "./icons";
import css from "./shell.module.css";
import { useShortcuts } from "./shortcuts";
import { Stepper, type Step, type StepName } from "./stepper";

interface ShellProps {
  recordingName?: string;
  steps: readonly Step[];
  current: StepName | null;
  children: ReactNode;
}

/** The frame around every screen: name, steps, scheme and keyboard help on top, the screen below. */
export function Shell({ recordingName, steps, current, children }: ShellProps) {
  const navigate = useNavigate();
  const { setColorScheme } = useMantineColorScheme();
  const scheme = useComputedColorScheme("dark");
  const [helpOpen, setHelpOpen] = useState(false);
  const toggleScheme = () => setColorScheme(scheme === "dark" ? "light" : "dark");

  useShortcuts("Everywhere", [
    { keys: "?", label: "Show these keys", run: () => setHelpOpen(true) },
    { keys: "t", label: "Dark or light", run: toggleScheme },
    { keys: "h", label: "Start page", run: () => void navigate("/") },
    ...steps.flatMap((step, index) => {
      const to = step.state === "locked" ? undefined : step.to;
      return to === undefined
        ? []
        : [{ keys: String(index + 1), label: `Step ${index + 1}: ${step.name}`, run: () => void navigate(to) }];
    }),
  ]);

  return (
    <div className={css.shell}>
      <header className={css.bar}>
        <div className={css.left}>
          <Link to="/" className={css.brand} aria-label="unsweep, start page">
            <img src="/mark.svg" width={22} height={22} alt="" />
            <span className={css.brandName} data-beside-name={recordingName !== undefined}>
              unsweep
            </span>
          </Link>
          {recordingName !== undefined && (
            <>
              <span className={css.slash} aria-hidden="true">
                /
              </span>
              <span className={`${css.name ?? ""} clip`} title={recordingName}>
                {recordingName}
              </span>
            </>
          )}
        </div>
        <Stepper steps={steps} current={current} />
        <div className={css.right}>
          <Tooltip label="Keyboard (?)">
            <ActionIcon variant="subtle" color="gray" aria-label="Keyboard shortcuts" onClick={() => setHelpOpen(true)}>
              <span className="num" aria-hidden="true">
                ?
              </span>
            </ActionIcon>
          </Tooltip>
          <Tooltip label={scheme === "dark" ? "Light (T)" : "Dark (T)"}>
            <ActionIcon
              variant="subtle"
              color="gray"
              aria-label={scheme === "dark" ? "Switch to light" : "Switch to dark"}
              onClick={toggleScheme}
            >
              <Icon name={scheme === "dark" ? "sun" : "moon"} size={18} />
            </ActionIcon>
          </Tooltip>
        </div>
      </header>
      {children}
      <HelpDialog opened={helpOpen} onClose={() => setHelpOpen(false)} />
    </div>
  );
}
