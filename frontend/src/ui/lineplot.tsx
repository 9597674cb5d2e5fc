import { useComputedColorScheme } from "@mantine/core";
import { useEffect, useRef, useState } from "react";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import css from "./plot.module.css";
import { logTicks, ticks } from "./ticks";

export interface Line {
  label: string;
  /** A CSS colour or a token such as `var(--axis-x)`. */
  color: string;
  values: readonly (number | null)[];
  dash?: number[];
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
  onPick,
}: LinePlotProps) {
  const box = useRef<HTMLDivElement>(null);
  const [hovered, setHovered] = useState<number | null>(null);
  const plot = useRef<uPlot | null>(null);
  const pick = useRef(onPick);
  const scheme = useComputedColorScheme("dark");
  const from = xRange?.[0] ?? null;
  const to = xRange?.[1] ?? null;
  const shape = JSON.stringify(lines.map((line) => [line.label, line.color, line.dash]));

  useEffect(() => {
    pick.current = onPick;
  });

  useEffect(() => {
    const element = box.current;
    if (element === null) return;
    const styles = JSON.parse(shape) as [string, string, number[] | null][];
    const ink = token("var(--ink-3)");
    const grid = token("var(--line)");
    const font = '11px "IBM Plex Sans", sans-serif';
    const axis = { stroke: ink, font, grid: { stroke: grid, width: 1 }, ticks: { show: false }, gap: 4 };
    const chart = new uPlot(
      {
        width: Math.max(40, element.clientWidth),
        height,
        legend: { show: false },
        padding: [8, 8, 0, 0],
        hooks: { setCursor: [(self) => setHovered(self.cursor.idx ?? null)] },
        cursor: { y: false, drag: { x: false, y: false }, points: { size: 5 } },
        scales: {
          x: { time: false, ...(from === null || to === null ? {} : { range: [from, to] as [number, number] }) },
          y: logarithmic ? logarithmicScale : {},
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
            values: (_, found) => found.map(shortNumber),
          },
        ],
        series: [
          {},
          ...styles.map(([name, color, dash]) => ({
            label: name,
            stroke: token(color),
            width: 1.4,
            points: { show: false },
            ...(dash === null ? {} : { dash }),
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
  }, [shape, scheme, height, xUnit, logarithmic, from, to]);

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
        {hovered !== null && x[hovered] !== undefined && (
          <span className={`num ${css.hovered ?? ""}`} aria-hidden="true">
            {shortNumber(x[hovered])} {xUnit}
          </span>
        )}
        <span className={css.legend}>
          {lines.map((line) => (
            <span key={line.label}>
              <i style={{ background: line.color }} />
              {line.label}
              {hovered !== null && <b className="num">{valueText(line.values[hovered])}</b>}
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

function valueText(value: number | null | undefined): string {
  return value === null || value === undefined ? " –" : ` ${shortNumber(value)}`;
}

function shortNumber(value: number): string {
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) return value.toExponential(0).replace("e+", "e");
  return String(Number(value.toPrecision(4))).replace("-", "−");
}
