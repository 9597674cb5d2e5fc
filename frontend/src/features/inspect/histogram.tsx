import { fixed } from "../../ui/format";
import css from "./inspect.module.css";

const width = 320;
const height = 92;
const foot = 16;

interface HistogramProps {
  edgesM: readonly number[];
  before: readonly number[];
  after: readonly number[];
}

/** Signed distances of points to their plane, before and after, as two outlines over one axis. */
export function Histogram({ edgesM, before, after }: HistogramProps) {
  const first = edgesM[0] ?? 0;
  const last = edgesM.at(-1) ?? 1;
  const most = Math.max(1, ...before, ...after);
  const x = (edge: number) => ((edge - first) / (last - first)) * width;
  const y = (n: number) => height - foot - (n / most) * (height - foot - 4);
  const outline = (counts: readonly number[]) =>
    `M0 ${height - foot}` +
    counts
      .map((n, i) => `L${x(edgesM[i] ?? 0).toFixed(1)} ${y(n).toFixed(1)}H${x(edgesM[i + 1] ?? 0).toFixed(1)}`)
      .join("") +
    `V${height - foot}Z`;
  return (
    <figure className={css.histogram} aria-label="Histogram of distances to the plane, before and after">
      <svg viewBox={`0 0 ${width} ${height}`} aria-hidden="true" preserveAspectRatio="none">
        <path d={outline(before)} data-which="before" />
        <path d={outline(after)} data-which="after" />
        <line x1={x(0)} x2={x(0)} y1={4} y2={height - foot} />
      </svg>
      <figcaption>
        <span className="num">{fixed(first * 1000, 0)}</span>
        <span className={css.key}>
          <i data-which="before" /> raw <i data-which="after" /> de-skewed
        </span>
        <span className="num">{fixed(last * 1000, 0)} mm</span>
      </figcaption>
    </figure>
  );
}
