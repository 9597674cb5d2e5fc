import { useRef, type KeyboardEvent, type PointerEvent } from "react";
import css from "./inspect.module.css";

interface WipeProps {
  share: number;
  left: string;
  right: string;
  onChange: (share: number) => void;
}

const steps: Partial<Record<string, number>> = {
  ArrowLeft: -0.02,
  ArrowDown: -0.02,
  ArrowRight: 0.02,
  ArrowUp: 0.02,
  PageDown: -0.1,
  PageUp: 0.1,
};

/** The line between two clouds, dragged across the canvas. */
export function Wipe({ share, left, right, onChange }: WipeProps) {
  const layer = useRef<HTMLDivElement>(null);
  const set = (value: number) => onChange(Math.max(0, Math.min(1, value)));
  const move = (event: PointerEvent) => {
    const box = layer.current?.getBoundingClientRect();
    if (box !== undefined && box.width > 0) set((event.clientX - box.left) / box.width);
  };
  const key = (event: KeyboardEvent) => {
    const step = event.key === "Home" ? -1 : event.key === "End" ? 1 : steps[event.key];
    if (step === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    set(share + step);
  };
  const percent = `${share * 100}%`;
  return (
    <div ref={layer} className={css.wipe}>
      <span className={css.wipeName} style={{ right: `calc(100% - ${percent} + 24px)` }}>
        {left}
      </span>
      <span className={css.wipeName} style={{ left: `calc(${percent} + 24px)` }}>
        {right}
      </span>
      <div
        className={css.wipeLine}
        style={{ left: percent }}
        role="slider"
        tabIndex={0}
        aria-label="Wipe"
        aria-orientation="horizontal"
        aria-valuemin={0}
        aria-valuemax={100}
        aria-valuenow={Math.round(share * 100)}
        aria-valuetext={`${Math.round(share * 100)} percent: ${left} on the left, ${right} on the right`}
        onKeyDown={key}
        onPointerDown={(event) => event.currentTarget.setPointerCapture(event.pointerId)}
        onPointerMove={(event) => {
          if (event.currentTarget.hasPointerCapture(event.pointerId)) move(event);
        }}
      >
        <span className={css.wipeGrip} aria-hidden="true">
          ‹ ›
        </span>
      </div>
    </div>
  );
}
