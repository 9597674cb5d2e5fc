import { Button } from "@mantine/core";
import { useRef, useState, type KeyboardEvent, type PointerEvent } from "react";
import type { ChangeRecording, DoctorReport } from "../../api/client";
import { useUsual } from "../../api/queries";
import { fixed } from "../../ui/format";
import { LinePlot } from "../../ui/lineplot";
import { dragged, moved, type Span } from "./span";
import css from "./recording.module.css";

interface SpanStripProps {
  timeline: DoctorReport["timeline"];
  still: readonly { start_s: number; end_s: number }[];
  durationS: number;
  startS: number | null;
  endS: number | null;
  pending: boolean;
  onUse: (span: ChangeRecording) => void;
}

/** Excitation over time, on which the span to use is dragged out. */
export function SpanStrip({ timeline, still, durationS, startS, endS, pending, onUse }: SpanStripProps) {
  const used: Span = { startS: startS ?? 0, endS: Math.min(endS ?? durationS, durationS) };
  const [wish, setWish] = useState<Span>(used);
  const shortestS = useUsual()?.shortest_span_s ?? 0;
  const anchor = useRef<number | null>(null);
  const overlay = useRef<HTMLDivElement>(null);
  const whole = wish.startS <= 0 && wish.endS >= durationS;
  const changed = Math.abs(wish.startS - used.startS) > 1e-6 || Math.abs(wish.endS - used.endS) > 1e-6;

  const timeAt = (event: PointerEvent) => {
    const box = overlay.current?.getBoundingClientRect();
    if (box === undefined || box.width === 0) return 0;
    return Math.max(0, Math.min(durationS, ((event.clientX - box.left) / box.width) * durationS));
  };
  const percent = (t: number) => `${(100 * t) / Math.max(durationS, 1e-9)}%`;
  const key = (end: "start" | "end") => (event: KeyboardEvent) => {
    const steps: Partial<Record<string, number>> = {
      ArrowLeft: -0.1,
      ArrowRight: 0.1,
      ArrowDown: -0.1,
      ArrowUp: 0.1,
      PageDown: -1,
      PageUp: 1,
    };
    const step = steps[event.key];
    if (step === undefined) return;
    event.preventDefault();
    setWish(moved(wish, end, (end === "start" ? wish.startS : wish.endS) + step, durationS, shortestS));
  };
  const handle = (end: "start" | "end") => (
    <div
      className={css.handle}
      role="slider"
      tabIndex={0}
      aria-label={end === "start" ? "Start of the span" : "End of the span"}
      aria-valuemin={0}
      aria-valuemax={durationS}
      aria-valuenow={end === "start" ? wish.startS : wish.endS}
      aria-valuetext={`${fixed(end === "start" ? wish.startS : wish.endS, 1)} seconds`}
      style={{ left: percent(end === "start" ? wish.startS : wish.endS) }}
      onKeyDown={key(end)}
      onPointerDown={(event) => {
        event.stopPropagation();
        event.currentTarget.setPointerCapture(event.pointerId);
      }}
      onPointerMove={(event) => {
        if (event.currentTarget.hasPointerCapture(event.pointerId))
          setWish(moved(wish, end, timeAt(event), durationS, shortestS));
      }}
    />
  );

  return (
    <section className={css.strip} aria-label="Span to use">
      <div className={css.stripPlot}>
        <LinePlot
          label="Excitation: rate of turn"
          x={timeline.t_s}
          lines={[{ label: "all axes", color: "var(--accent)", values: timeline.rotation_norm_deg_s }]}
          xUnit="s"
          yUnit="°/s"
          height={112}
          xRange={[0, durationS]}
        />
        <div
          ref={overlay}
          className={css.overlay}
          onPointerDown={(event) => {
            anchor.current = timeAt(event);
            event.currentTarget.setPointerCapture(event.pointerId);
          }}
          onPointerMove={(event) => {
            if (
              anchor.current !== null &&
              event.currentTarget.hasPointerCapture(event.pointerId) &&
              Math.abs(timeAt(event) - anchor.current) > durationS / 200
            ) {
              setWish(dragged(anchor.current, timeAt(event), durationS, shortestS));
            }
          }}
          onPointerUp={() => {
            anchor.current = null;
          }}
        >
          {still.map((span) => (
            <div
              key={span.start_s}
              className={css.still}
              style={{ left: percent(span.start_s), width: percent(span.end_s - span.start_s) }}
            >
              <span>still</span>
            </div>
          ))}
          <div className={css.outside} style={{ left: 0, width: percent(wish.startS) }} />
          <div className={css.outside} style={{ left: percent(wish.endS), right: 0 }} />
          {handle("start")}
          {handle("end")}
        </div>
      </div>
      <div className={css.stripFoot}>
        <span className="small">
          {whole ? "The whole recording: " : "Span: "}
          <span className="num">
            {fixed(wish.startS, 1)} to {fixed(wish.endS, 1)} s
          </span>
          <span className="dim"> ({fixed(wish.endS - wish.startS, 1)} s). Drag across the curve to use a part.</span>
        </span>
        {!whole && (
          <Button size="compact-xs" variant="default" onClick={() => setWish({ startS: 0, endS: durationS })}>
            Whole recording
          </Button>
        )}
        <Button
          size="compact-xs"
          disabled={!changed}
          loading={pending}
          onClick={() =>
            onUse(
              whole
                ? { start_s: null, end_s: null }
                : { start_s: Number(wish.startS.toFixed(2)), end_s: Number(wish.endS.toFixed(2)) },
            )
          }
        >
          Use this span
        </Button>
      </div>
    </section>
  );
}
