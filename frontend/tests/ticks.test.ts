import { describe, expect, it } from "vitest";
import { logTicks, ticks } from "../src/ui/ticks";

const seeded = (seed: number) => () => {
  seed = (seed * 16807) % 2147483647;
  return seed / 2147483647;
};

describe("ticks of an axis", () => {
  // Fails with uPlot's own distance between ticks (one tick on a low plot); with steps that end before a range is covered.
  it("are three or more, round and inside, whatever the range", () => {
    const random = seeded(7);
    for (let i = 0; i < 2000; i += 1) {
      const low = (random() - 0.5) * 10 ** (random() * 8 - 4);
      const high = low + 10 ** (random() * 8 - 4);
      const most = 2 + Math.floor(random() * 10);
      const found = ticks(low, high, most);
      expect(found.length).toBeGreaterThanOrEqual(3);
      expect(found.length).toBeLessThanOrEqual(Math.max(most, 3) + 3);
      const width = high - low;
      expect(found[0]).toBeGreaterThanOrEqual(low - 1e-6 * width);
      expect(found.at(-1)).toBeLessThanOrEqual(high + 1e-6 * width);
      const apart = found.slice(1).map((tick, k) => tick - (found[k] ?? NaN));
      expect(Math.max(...apart) - Math.min(...apart)).toBeLessThan(1e-6 * width);
    }
  });

  it("are those that a person would take", () => {
    expect(ticks(0, 150, 3)).toEqual([0, 50, 100, 150]);
    expect(ticks(-120, 150, 3)).toEqual([-100, 0, 100]);
    expect(ticks(3, 3, 4)).toEqual([3]);
  });

  // Fails when only powers of ten count: a cost that falls from 900 to 300 had none.
  it("are three or more on a logarithmic axis", () => {
    expect(logTicks(0.5, 2e4, 5)).toEqual([1, 10, 100, 1000, 10000]);
    expect(logTicks(80, 2000, 5)).toEqual([100, 300, 1000]);
    expect(logTicks(300, 900, 4).length).toBeGreaterThanOrEqual(3);
    expect(logTicks(1000.1, 1000.9, 4).length).toBeGreaterThanOrEqual(3);
    expect(logTicks(1e-9, 1e9, 4).length).toBeLessThanOrEqual(5);
  });
});
