/** Where an axis has its ticks: round numbers, never fewer than three as long as there is anything between its ends. */

const fewest = 3;
const steps = [1, 2, 2.5, 5];

function multiples(low: number, high: number, step: number): number[] {
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, i) => (first + i) * step || 0);
}

/** Round ticks from low to high: at most `most` where that leaves three. */
export function ticks(low: number, high: number, most: number): number[] {
  if (!(high > low) || !Number.isFinite(high - low)) return [low];
  const finest = Math.floor(Math.log10((high - low) / Math.max(most, fewest))) - 1;
  let found: number[] = [];
  for (let power = finest; power <= finest + 4; power += 1) {
    for (const round of steps) {
      const next = multiples(low, high, round * 10 ** power);
      if (next.length < fewest && found.length > 0) return found;
      found = next;
      if (found.length <= Math.max(most, fewest)) return found;
    }
  }
  return found;
}

const withinDecade = [[1], [1, 3], [1, 2, 5], [1, 2, 3, 4, 5, 6, 7, 8, 9]];

/** Ticks of a logarithmic axis: powers of ten, with digits between them where there are too few, and round ones within a step. */
export function logTicks(low: number, high: number, most: number): number[] {
  if (!(low > 0) || !(high > low)) return [low];
  const [from, to] = [Math.floor(Math.log10(low)), Math.ceil(Math.log10(high))];
  const powers = Array.from({ length: to - from + 1 }, (_, i) => from + i);
  for (const digits of withinDecade) {
    const found = powers
      .flatMap((power) => digits.map((digit) => digit * 10 ** power))
      .filter((tick) => tick >= low * (1 - 1e-9) && tick <= high * (1 + 1e-9));
    if (found.length >= fewest) return thinned(found, Math.max(most, fewest));
  }
  return ticks(low, high, most);
}

/** Every second, third... so that no more than `most` are left. */
function thinned(found: readonly number[], most: number): number[] {
  const every = Math.ceil(found.length / most);
  const kept = found.filter((_, i) => i % every === 0);
  return kept.length >= fewest ? kept : found.slice();
}
