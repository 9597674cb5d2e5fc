import { Button } from "@mantine/core";
import { useEffect, useRef, type ReactNode } from "react";
import { asFault } from "../api/fault";
import { LevelIcon, type Tone } from "./icons";
import { sentenceCase } from "./words";
import css from "./notice.module.css";

interface NoticeProps {
  level: Tone;
  children: ReactNode;
  /** What follows from it, or how to fix it. */
  more?: ReactNode;
  actions?: ReactNode;
}

/** One sentence with its weight, where it matters. */
export function Notice({ level, children, more, actions }: NoticeProps) {
  return (
    <div className={css.notice} data-level={level} role={level === "error" ? "alert" : undefined}>
      <LevelIcon level={level} />
      <div>
        <div>{typeof children === "string" ? sentenceCase(children) : children}</div>
        {more !== undefined && more !== "" && <div className={css.more}>{more}</div>}
        {actions !== undefined && <div className={css.actions}>{actions}</div>}
      </div>
    </div>
  );
}

/** What went wrong, in the server's own sentence, with a way on. */
export function Fault({ error, onRetry }: { error: unknown; onRetry?: () => void }) {
  const fault = asFault(error);
  // It may come up below the fold of a scrolling panel, under the button that was pressed.
  const place = useRef<HTMLDivElement>(null);
  useEffect(() => {
    place.current?.scrollIntoView({ block: "nearest" });
  }, [fault.message]);
  return (
    <div ref={place}>
      <Notice
        level="error"
        actions={
          onRetry === undefined ? undefined : (
            <Button size="compact-sm" variant="default" onClick={onRetry}>
              Try again
            </Button>
          )
        }
      >
        {fault.message}
      </Notice>
    </div>
  );
}

/** A drawn empty or waiting state in the middle of its box. */
export function StateBox({ title, children, icon }: { title: string; children?: ReactNode; icon?: ReactNode }) {
  return (
    <div className={css.state}>
      {icon}
      <h2>{title}</h2>
      {children !== undefined && <div>{children}</div>}
    </div>
  );
}
