import { useRef, useState, type PointerEvent } from "react";
import { useQuery } from "@tanstack/react-query";
import type { ScanQuality } from "../../api/client";
import { scansQuery } from "../../api/queries";
import { asFault } from "../../api/fault";
import { fixed } from "../../ui/format";
import css from "./inspect.module.css";
import { badScans, type TimeSpan } from "./spans";

const width = 1000;
const height = 56;
const top = 4;

interface ScanStripProps {
  jobId: string;
  scan: number;
  /** Spans to leave out of the next solve. */
  wished: readonly TimeSpan[];
  /** Spans that this run left out. */
  excluded: readonly TimeSpan[];
  onScan: (scan: number) => void;
  onLeaveOut: (span: TimeSpan) => void;
}

/** Every scan's spread about the planes: click one to go there, drag across some to leave them out. */
export function ScanStrip({ jobId, ...rest }: ScanStripProps) {
  const scans = useQuery(scansQuery(jobId));
  if (scans.isPending)
    return <div className={css.strip} role="status" aria-busy="true" aria-label="Loading the scans' residuals" />;
  if (scans.isError)
    return <p className={`${css.strip ?? ""} ${css.stripNote ?? ""}`}>{asFault(scans.error).message}</p>;
  return <Strip quality={scans.data} {...rest} />;
}

function Strip({
  quality,
  scan,
  wished,
  excluded,
  onScan,
  onLeaveOut,
}: Omit<ScanStripProps, "jobId"> & { quality: ScanQuality }) {
  const box = useRef<HTMLDivElement>(null);
  /** Where a drag began and where it is now, seconds. */
  const [drag, setDrag] = useState<TimeSpan | null>(null);
  const [over, setOver] = useState<number | null>(null);
  const times = quality.t_s;
  const last = times.at(-1) ?? 0;
  const period = times.length > 1 ? last / (times.length - 1) : 0.1;
  const end = Math.max(period, last + period);
  const bad = badScans(quality.rms_m);
  const known = quality.rms_m.filter((value) => value !== null);
  const most = Math.max(1e-4, ...known) * 1.05;
  const x = (t: number) => (t / end) * width;
  const y = (rms: number) => height - (rms / most) * (height - top);
  const percent = (t: number) => `${(100 * Math.max(0, Math.min(t, end))) / end}%`;
  const timeAt = (event: PointerEvent) => {
    const rect = box.current?.getBoundingClientRect();
    return rect === undefined || rect.width === 0
      ? 0
      : Math.max(0, Math.min(end, ((event.clientX - rect.left) / rect.width) * end));
  };
  const nearest = (t: number) => Math.max(0, Math.min(times.length - 1, Math.floor(t / period)));
  const dragged = drag !== null && Math.abs(drag[1] - drag[0]) > Math.max(period, end / 200) ? ordered(drag) : null;
  const shown = over ?? scan;
  const rms = quality.rms_m[shown];
  const share = quality.share[shown];

  return (
    <figure
      className={css.strip}
      aria-label={`Spread of each scan’s points within 30 cm of its planes, furniture too, millimetres over seconds; ${bad.length} of ${times.length} scans stand out`}
    >
      <figcaption>
        <span className={css.stripTitle}>
          Spread of each scan<span className={css.stripWords}>: all within 30 cm of a plane, furniture too</span>
        </span>
        <span className="num">
          {rms === null || rms === undefined ? "no motion here" : `${fixed(rms * 1000, 1)} mm`}
        </span>
        <span className="dim">
          scan {shown + 1}
          {share !== null && share !== undefined && (
            <>
              , {percentText(share)} <span className={css.stripWords}>within 10 cm of a plane</span>
              <span className={css.stripShort}>on planes</span>
            </>
          )}
        </span>
      </figcaption>
      <div
        ref={box}
        className={css.stripPlot}
        data-testid="scan-strip"
        onPointerDown={(event) => {
          event.currentTarget.setPointerCapture(event.pointerId);
          setDrag([timeAt(event), timeAt(event)]);
        }}
        onPointerMove={(event) => {
          setOver(nearest(timeAt(event)));
          if (drag !== null) setDrag([drag[0], timeAt(event)]);
        }}
        onPointerUp={(event) => {
          if (dragged !== null) onLeaveOut(dragged);
          else if (drag !== null) onScan(nearest(timeAt(event)));
          setDrag(null);
        }}
        onPointerLeave={() => setOver(null)}
      >
        <svg viewBox={`0 0 ${width} ${height}`} preserveAspectRatio="none" aria-hidden="true">
          {quality.rms_m.map((value, i) =>
            value === null ? null : (
              <rect
                key={i}
                x={x(times[i] ?? 0)}
                width={Math.max(0.6, x(period) * 0.8)}
                y={y(value)}
                height={height - y(value)}
                data-bad={bad.includes(i)}
                data-now={i === scan}
              />
            ),
          )}
        </svg>
        {excluded.map(([from, to]) => (
          <div
            key={`x${from}`}
            className={css.excluded}
            data-kind="done"
            style={{ left: percent(from), width: `calc(${percent(to)} - ${percent(from)})` }}
          >
            <span>left out</span>
          </div>
        ))}
        {wished.map(([from, to]) => (
          <div
            key={`w${from}`}
            className={css.excluded}
            data-kind="wished"
            style={{ left: percent(from), width: `calc(${percent(to)} - ${percent(from)})` }}
          />
        ))}
        {dragged !== null && (
          <div
            className={css.excluded}
            data-kind="wished"
            style={{ left: percent(dragged[0]), width: `calc(${percent(dragged[1])} - ${percent(dragged[0])})` }}
          />
        )}
        <div className={css.cursor} style={{ left: percent((times[scan] ?? 0) + period / 2) }} />
      </div>
    </figure>
  );
}

/** All of them only where not one is left out. */
function percentText(share: number): string {
  const percent = Math.round(share * 100);
  return share < 1 && percent === 100 ? "over 99 %" : `${percent} %`;
}

function ordered([a, b]: TimeSpan): TimeSpan {
  return a <= b ? [a, b] : [b, a];
}
