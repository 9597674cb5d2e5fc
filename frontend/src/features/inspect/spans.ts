import type { Run } from "../../api/client";

/** Start and end in seconds after the first scan. */
export type TimeSpan = readonly [number, number];

/** What a run left out. */
export function spansOf(run: Run): [number, number][] {
  return run.job.settings.excluded_spans_s.map((span): [number, number] => [Number(span[0]), Number(span[1])]);
}

/** `3.1-4.25,7-8`: spans in a URL. */
export function writeSpans(spans: readonly TimeSpan[]): string {
  return spans.map(([start, end]) => `${Number(start.toFixed(3))}-${Number(end.toFixed(3))}`).join(",");
}

export function parseSpans(text: string): TimeSpan[] {
  return text
    .split(",")
    .map((part) => /^(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)$/.exec(part))
    .flatMap((found): TimeSpan[] => {
      const [start, end] = [Number(found?.[1] ?? NaN), Number(found?.[2] ?? NaN)];
      return start < end ? [[start, end]] : [];
    });
}

/** The spans with one more; those that touch become one. In order of time. */
export function joined(spans: readonly TimeSpan[], more: TimeSpan): TimeSpan[] {
  const out: TimeSpan[] = [];
  for (const span of [...spans, more].sort((a, b) => a[0] - b[0])) {
    const last = out.at(-1);
    if (last !== undefined && span[0] <= last[1]) out[out.length - 1] = [last[0], Math.max(last[1], span[1])];
    else out.push(span);
  }
  return out;
}

/** The spans without one of them. */
export function without(spans: readonly TimeSpan[], gone: TimeSpan): TimeSpan[] {
  return spans.filter((span) => span[0] !== gone[0] || span[1] !== gone[1]);
}

export function sameSpans(a: readonly TimeSpan[], b: readonly TimeSpan[]): boolean {
  return writeSpans(a) === writeSpans(b);
}

/** A span that holds the scan at `t` and no other, when scans come every `period` seconds. */
export function spanOfScan(t: number, period: number): TimeSpan {
  return [Math.max(0, t + 0.05 * period), t + 0.9 * period];
}

/** Whether the scan at `t` is left out: most of it, where a span was dragged. */
export function holdsScan(spans: readonly TimeSpan[], t: number, period: number): boolean {
  const middle = t + 0.475 * period;
  return spans.some(([start, end]) => start <= middle && middle <= end);
}

/** The spans without the scan at `t`; what else a span holds stays left out. Shreds of a scan are none. */
export function withoutScan(spans: readonly TimeSpan[], t: number, period: number): TimeSpan[] {
  const [before, after] = [t - 0.1 * period, t + 1.05 * period];
  return spans.flatMap(([start, end]): TimeSpan[] => {
    if (end <= before || start >= after) return [[start, end]];
    const left: TimeSpan[] = [
      [start, before],
      [after, end],
    ];
    return left.filter(([from, to]) => to - from > 0.5 * period);
  });
}

/** Scans whose spread stands out: five robust standard deviations above the median, and no less than half as much again. */
export function badScans(rms: readonly (number | null)[]): number[] {
  const known = rms.filter((value) => value !== null).sort((a, b) => a - b);
  if (known.length < 8) return [];
  const median = known[Math.floor(known.length / 2)] ?? 0;
  const deviations = known.map((value) => Math.abs(value - median)).sort((a, b) => a - b);
  const sigma = 1.4826 * (deviations[Math.floor(deviations.length / 2)] ?? 0);
  const limit = median + Math.max(5 * sigma, 0.5 * median);
  return rms.flatMap((value, i) => (value !== null && value > limit ? [i] : []));
}
