import { useComputedColorScheme } from "@mantine/core";
import { useEffect, useRef, useState } from "react";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { decimalsFor } from "./format";
import css from "./plot.module.css";
import { logTicks, ticks } from "./ticks";

export interface Line {
  label: string;
  /** A CSS colour or a token such as `var(--axis-x)`. */
  color: string;
  values: readonly (number | null)[];
  dash?: number[];
  /** One standard deviation of each value: points with bars instead of a curve. */
  sigmas?: readonly (number | null)[];
}

interface LinePlotProps {
  /** What the plot shows, for people who do not see it. */
  label: string;
  x: readonly number[];
  lines: readonly Line[];
  xUnit: string;
  yUnit: string;
  height: number;
  logarithmic?: boolean;
  /** Ends of the axis; the ends of the data where left out. */
  xRange?: readonly [number, number];
  yRange?: readonly [number, number];
  /** A click on the plot, in x units. */
  onPick?: (x: number) => void;
}

/** uPlot's enum of distributions exists in its types only; 3 is the logarithmic one. */
const logarithmicScale: uPlot.Scale = JSON.parse('{"distr":3}') as uPlot.Scale;

function token(color: string): string {
  const name = /^var\((--[\w-]+)\)$/.exec(color)?.[1];
  return name === undefined ? color : getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Curves over one axis. Data are exchanged without rebuilding; only a new set of lines or scheme rebuilds. */
export function LinePlot({
  label,
  x,
  lines,
  xUnit,
  yUnit,
  height,
  logarithmic = false,
  xRange,
  yRange,
  onPick,
}: LinePlotProps) {
  const box = useRef<HTMLDivElement>(null);
  const [hovered, setHovered] = useState<number | null>(null);
  const plot = useRef<uPlot | null>(null);
  const pick = useRef(onPick);
  const scheme = useComputedColorScheme("dark");
  const from = xRange?.[0] ?? null;
  const to = xRange?.[1] ?? null;
  const bottom = yRange?.[0] ?? null;
  const top = yRange?.[1] ?? null;
  const shape = JSON.stringify(lines.map((line) => [line.label, line.color, line.dash, line.sigmas !== undefined]));
  const drawn = useRef(lines);

  useEffect(() => {
    pick.current = onPick;
    drawn.current = lines;
  });

  useEffect(() => {
    const element = box.current;
    if (element === null) return;
    const styles = JSON.parse(shape) as [string, string, number[] | null, boolean][];
    const ink = token("var(--ink-3)");
    const grid = token("var(--line)");
    const font = '11px "IBM Plex Sans", sans-serif';
    const axis = { stroke: ink, font, grid: { stroke: grid, width: 1 }, ticks: { show: false }, gap: 4 };
    const chart = new uPlot(
      {
        width: Math.max(40, element.clientWidth),
        height,
        legend: { show: false },
        padding: [8, 16, 0, 0],
        hooks: {
          setCursor: [(self) => setHovered(self.cursor.idx ?? null)],
          draw: [(self) => drawBars(self, drawn.current)],
        },
        cursor: {
          y: false,
          drag: { x: false, y: false },
          points: { size: 5, show: !styles.some((style) => style[3]) },
        },
        scales: {
          x: { time: false, ...(from === null || to === null ? {} : { range: [from, to] as [number, number] }) },
          y: {
            ...(logarithmic ? logarithmicScale : {}),
            ...(bottom === null || top === null ? {} : { range: [bottom, top] as [number, number] }),
          },
        },
        axes: [
          {
            ...axis,
            size: 24,
            splits: (self, _, low, high) => ticks(low, high, Math.floor(self.bbox.width / devicePixelRatio / 48)),
            values: (_, found) =>
              found.map((tick, i) =>
                i === found.length - 1 && fitsTick(xUnit) ? `${shortNumber(tick)} ${xUnit}` : shortNumber(tick),
              ),
          },
          {
            ...axis,
            size: 46,
            splits: (_, __, low, high) => (logarithmic ? logTicks : ticks)(low, high, Math.floor((height - 32) / 24)),
            // uPlot's own filter leaves out what is no power of ten.
            filter: (_, splits) => splits,
            values: (_, found) => found.map((tick) => shortNumber(tick)),
          },
        ],
        series: [
          {},
          ...styles.map(([name, color, dash, barred]) => ({
            label: name,
            stroke: token(color),
            width: 1.4,
            points: { show: false },
            ...(dash === null ? {} : { dash }),
            ...(barred ? { paths: () => null } : {}),
          })),
        ],
      },
      [[], ...styles.map(() => [])],
      element,
    );
    plot.current = chart;
    const observer = new ResizeObserver(() => chart.setSize({ width: Math.max(40, element.clientWidth), height }));
    observer.observe(element);
    const click = () => {
      const left = chart.cursor.left ?? -1;
      if (left >= 0) pick.current?.(chart.posToVal(left, "x"));
    };
    chart.over.addEventListener("click", click);
    return () => {
      observer.disconnect();
      chart.destroy();
      plot.current = null;
    };
  }, [shape, scheme, height, xUnit, logarithmic, from, to, bottom, top]);

  useEffect(() => {
    plot.current?.setData([[...x], ...lines.map((line) => [...line.values])] as uPlot.AlignedData);
  });

  return (
    <figure className={css.plot} aria-label={`${label}, ${yUnit} over ${xUnit}`}>
      <figcaption className={css.caption}>
        <span>
          {label} <span className={css.unit}>{yUnit}</span>
          {!fitsTick(xUnit) && <span className={css.unit}> by {xUnit}</span>}
        </span>
        {/* Beside three values with their bars there is no room for it, and the cursor's line shows it. */}
        {hovered !== null && x[hovered] !== undefined && !lines.some((line) => line.sigmas !== undefined) && (
          <span className={`num ${css.hovered ?? ""}`} aria-hidden="true">
            {shortNumber(x[hovered])} {xUnit}
          </span>
        )}
        <span className={css.legend}>
          {lines.map((line) => (
            <span key={line.label}>
              <i style={{ background: line.color }} />
              {line.label}
              {hovered !== null && <b className="num">{valueText(line.values[hovered], line.sigmas?.[hovered])}</b>}
            </span>
          ))}
        </span>
      </figcaption>
      <div ref={box} className={css.canvas} style={{ height }} />
    </figure>
  );
}

/** A longer word beside the last tick would be cut off by the plot's edge. */
function fitsTick(unit: string): boolean {
  return unit.length <= 3;
}

function valueText(value: number | null | undefined, sigma: number | null | undefined): string {
  if (value === null || value === undefined) return " –";
  return sigma === null || sigma === undefined
    ? ` ${shortNumber(value)}`
    : ` ${besides(value, sigma)}±${shortNumber(sigma, 2)}`;
}

/** A value with as many decimals as two digits of its standard deviation have. */
function besides(value: number, sigma: number): string {
  const decimals = sigma > 0 ? Math.min(6, decimalsFor(sigma)) : 3;
  return value.toFixed(decimals).replace("-", "−");
}

/** Between the bars of one part. */
const barGap = 7;

/** Points with bars of one standard deviation, those of one x side by side, within the plot's own rectangle. */
function drawBars(chart: uPlot, lines: readonly Line[]) {
  const barred = lines.filter((line) => line.sigmas !== undefined);
  if (barred.length === 0) return;
  const { ctx, bbox } = chart;
  const dot = devicePixelRatio;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.lineWidth = 1.4 * dot;
  barred.forEach((line, k) => {
    ctx.strokeStyle = ctx.fillStyle = token(line.color);
    const aside = (k - (barred.length - 1) / 2) * barGap * dot;
    line.values.forEach((value, i) => {
      const at = chart.data[0][i];
      const sigma = line.sigmas?.[i];
      if (value === null || at === undefined || sigma === null || sigma === undefined) return;
      const x = chart.valToPos(at, "x", true) + aside;
      const off = beyond(value, chart.scales["y"]?.min ?? value, chart.scales["y"]?.max ?? value);
      if (off !== 0) {
        drawArrow(ctx, x, off > 0 ? bbox.top : bbox.top + bbox.height, off, dot);
        return;
      }
      ctx.beginPath();
      ctx.moveTo(x, chart.valToPos(value - sigma, "y", true));
      ctx.lineTo(x, chart.valToPos(value + sigma, "y", true));
      ctx.stroke();
      ctx.beginPath();
      ctx.arc(x, chart.valToPos(value, "y", true), 2.5 * dot, 0, 2 * Math.PI);
      ctx.fill();
    });
  });
  ctx.restore();
}

/** On which side of an axis a value lies: 1 above it, -1 below, 0 on it. */
export function beyond(value: number, low: number, high: number): -1 | 0 | 1 {
  return value > high ? 1 : value < low ? -1 : 0;
}

/** A point that the axis does not reach, as an arrow at its end: left out, it would seem that there is none. */
function drawArrow(ctx: CanvasRenderingContext2D, x: number, edge: number, up: 1 | -1, dot: number) {
  ctx.beginPath();
  ctx.moveTo(x, edge);
  ctx.lineTo(x - 4 * dot, edge + up * 7 * dot);
  ctx.lineTo(x + 4 * dot, edge + up * 7 * dot);
  ctx.fill();
}

function shortNumber(value: number, digits = 4): string {
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) return value.toExponential(0).replace("e+", "e");
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}
