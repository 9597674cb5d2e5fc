/** How far an upload was at an instant of a monotonic clock. */
export interface RateSample {
  atMs: number;
  bytes: number;
}

const windowMs = 8000;

/** Keeps the samples of the last seconds: speed is what it is now, not what it was on average. */
export function addSample(samples: readonly RateSample[], next: RateSample): RateSample[] {
  return [...samples.filter((sample) => next.atMs - sample.atMs <= windowMs), next];
}

export interface UploadRate {
  sent: number;
  bytesPerSecond: number | null;
  secondsLeft: number | null;
}

export function rateOf(samples: readonly RateSample[], size: number): UploadRate {
  const first = samples[0];
  const last = samples.at(-1);
  if (first === undefined || last === undefined) return { sent: 0, bytesPerSecond: null, secondsLeft: null };
  const seconds = (last.atMs - first.atMs) / 1000;
  const bytes = last.bytes - first.bytes;
  if (seconds < 0.3 || bytes <= 0) return { sent: last.bytes, bytesPerSecond: null, secondsLeft: null };
  const bytesPerSecond = bytes / seconds;
  return { sent: last.bytes, bytesPerSecond, secondsLeft: (size - last.bytes) / bytesPerSecond };
}
