import { describe, expect, it } from "vitest";
import { parseOld, writeOld } from "../src/features/inspect/oldtext";
import {
  badScans,
  holdsScan,
  joined,
  parseSpans,
  sameSpans,
  spanOfScan,
  without,
  withoutScan,
  writeSpans,
  type TimeSpan,
} from "../src/features/inspect/spans";
import { readWish, writeWish } from "../src/features/inspect/wish";

describe("spans of time", () => {
  // Fails with spans that touch kept apart, or taken out of order.
  it("become one where they touch", () => {
    expect(joined([[5, 6]], [1, 2])).toEqual([
      [1, 2],
      [5, 6],
    ]);
    expect(
      joined(
        [
          [1, 3],
          [5, 6],
        ],
        [2, 5.5],
      ),
    ).toEqual([[1, 6]]);
    expect(
      without(
        [
          [1, 2],
          [5, 6],
        ],
        [5, 6],
      ),
    ).toEqual([[1, 2]]);
  });
  // Fails with the milliseconds cut off.
  it("survive the URL", () => {
    const spans = [
      [0, 0.125],
      [12.5, 14],
    ] as const;
    expect(parseSpans(writeSpans(spans))).toEqual(spans);
    expect(parseSpans("none")).toEqual([]);
    expect(parseSpans("4-2,x,1-1")).toEqual([]);
    expect(sameSpans([[1, 2]], [[1, 2.0001]])).toBe(true);
  });
  // Fails when a scan that is left out cannot be had back; when its neighbours come back with it, or shreds of it stay.
  it("lose one scan again, and no other", () => {
    const at = (scan: number) => scan * 0.1;
    const out = [4, 5, 6].reduce((spans: TimeSpan[], scan) => joined(spans, spanOfScan(at(scan), 0.1)), []);
    const held = (spans: readonly TimeSpan[]) => [3, 4, 5, 6, 7].filter((scan) => holdsScan(spans, at(scan), 0.1));
    expect(held(out)).toEqual([4, 5, 6]);
    expect(held(withoutScan(out, at(5), 0.1))).toEqual([4, 6]);
    const dragged: TimeSpan[] = [[0.38, 0.72]];
    expect(held(withoutScan(dragged, at(5), 0.1))).toEqual([4, 6]);
    expect(withoutScan([spanOfScan(at(5), 0.1)], at(5), 0.1)).toEqual([]);
  });
  // Fails with a span that reaches into the next scan's first point.
  it("of one scan hold no other scan's start", () => {
    const [from, to] = spanOfScan(3.0, 0.1);
    expect(from).toBeGreaterThan(2.999);
    expect(to).toBeLessThan(3.1);
  });
});

describe("scans that stand out", () => {
  // Fails with the mean in place of the median: one huge scan hides a large one.
  it("are found beside a huge one", () => {
    const rms = Array.from({ length: 40 }, (_, i) => 0.014 + 0.0002 * (i % 3));
    expect(badScans(rms)).toEqual([]);
    expect(badScans(rms.map((value, i) => (i === 7 ? 0.03 : i === 9 ? 5 : value)))).toEqual([7, 9]);
    expect(badScans([null, 0.01])).toEqual([]);
  });
});

describe("the URL of an inspection", () => {
  const old = { translation_m: [0.1, -0.2, 0.3], quaternion_xyzw: [0, 0, 0, 1], time_offset_s: null, name: "" };
  // Fails with the missing time offset read as zero.
  it("keeps an old extrinsic, with its time offset or without", () => {
    expect(parseOld(writeOld(old))).toEqual(old);
    expect(parseOld(writeOld({ ...old, time_offset_s: -0.02 }))).toEqual({ ...old, time_offset_s: -0.02 });
    expect(parseOld("1,2,3")).toBeNull();
    expect(parseOld("0,0,0,0,0,0,2")).toBeNull();
  });
  // Fails with a wipe between raw and de-skewed over a surface that is the same on both sides, asked for or typed.
  it("has a surface of the de-skewed map alone", () => {
    const read = (query: URLSearchParams) => readWish(query, 0);
    const laid = writeWish(new URLSearchParams("show=wipe&map=1"), { extent: "surface" });
    expect(read(laid)).toMatchObject({ extent: "surface", show: "deskewed" });
    expect(read(writeWish(laid, { show: "side" }))).toMatchObject({ extent: "map", show: "side" });
    expect(read(writeWish(laid, { show: "deskewed" })).extent).toBe("surface");
    expect(read(writeWish(laid, { scan: 3 })).extent).toBe("surface");
    expect(read(writeWish(laid, { extent: "scan" })).show).toBe("wipe");
    expect(read(new URLSearchParams("show=wipe&map=surface")).show).toBe("deskewed");
  });
  // Fails when Inspect opens on points among points, in which no difference is to be seen.
  it("opens where the motion shows", () => {
    expect(readWish(new URLSearchParams(), 5)).toMatchObject({ show: "side", extent: "map", colorBy: "residual" });
    expect(readWish(writeWish(new URLSearchParams(), { extent: "scan" }), 5)).toMatchObject({
      extent: "scan",
      scan: 5,
    });
  });
  // Fails with a part of the wish that is not written, or not read.
  it("says everything that is wished for", () => {
    const wish = {
      ...readWish(new URLSearchParams(), 5),
      scan: 7,
      show: "wipe" as const,
      against: "old" as const,
      extent: "map" as const,
      wipe: 0.25,
      colorBy: "residual" as const,
      old,
      leaveOut: [[1, 2] as const],
    };
    expect(readWish(writeWish(new URLSearchParams("job=x"), wish), 0)).toEqual(wish);
    expect(writeWish(new URLSearchParams("job=x"), wish).get("job")).toBe("x");
    expect(readWish(new URLSearchParams("against=old&show=old&wipe=9"), 0)).toMatchObject({
      against: "raw",
      show: "raw",
      wipe: 1,
    });
  });
});
