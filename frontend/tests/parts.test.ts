import { describe, expect, it } from "vitest";
import { beyond } from "../src/ui/lineplot";
import { offsetsOf, plotsOf, type Part } from "../src/features/result/partsof";

function part(turnStd: number): Part {
  return {
    t_start_s: 0,
    t_end_s: 1,
    rotation_shift_deg: [0.01, -0.02, 0],
    translation_shift_m: [0.001, -0.002, 0.0005],
    time_offset_shift_s: -0.0002,
    rotation_std_deg: [turnStd, turnStd, turnStd],
    translation_std_m: [0.002, 0.001, 0.003],
    time_offset_std_s: 0.0003,
  };
}

describe("answers of parts", () => {
  // Fails when the longest bar counts, or metres and seconds are drawn as they are.
  it("are drawn in degrees, millimetres and milliseconds, none pressed flat by one that says nothing", () => {
    const [turn, place, late] = plotsOf([part(0.03), part(0.03), part(57), part(0.03)]);
    expect(turn?.range[1]).toBeCloseTo(1.1 * 0.05);
    expect(turn?.lines[0]?.sigmas?.[2]).toBe(57);
    expect(place?.lines.map((line) => line.values[0])).toEqual([1, -2, 0.5]);
    expect(place?.range).toEqual([-1.1 * 3.5, 1.1 * 3.5]);
    expect(late?.lines[0]?.values[0]).toBeCloseTo(-0.2);
    expect(late?.lines[0]?.sigmas?.[0]).toBeCloseTo(0.3);
  });

  // Fails when a point that the axis does not reach is drawn nowhere.
  it("are told beyond an axis that does not reach them", () => {
    expect([-1.2, -1, 0.3, 1, 1.2].map((value) => beyond(value, -1, 1))).toEqual([-1, 0, 0, 0, 1]);
  });

  it("have offsets in milliseconds from the answer", () => {
    const profile = { first_s: -0.02, step_s: 0.01, likeness: [0.5, null, 1], best_s: 0, text: "" };
    expect(offsetsOf(profile)).toEqual([-20, -10, 0]);
  });
});
