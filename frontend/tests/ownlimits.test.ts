import { expect, test } from "vitest";
import type { CalibrationResult } from "../src/api/client";
import { asLimits, beyond } from "../src/api/ownlimits";

const result = {
  uncertainty: {
    translation_std_m: [0.001, 0.0052, 0.02],
    rotation_std_deg: [0.04, 0.2, 0.05],
    time_offset_std_s: 0.00005,
  },
} as unknown as CalibrationResult;

/**
 * Oracle: the table's digits. Mutations: 5.20 beside its 5.2; metres held against millimetres; the last axis left out; a limit
 * that is met counted as beyond.
 */
test("axes beyond one's own limits are named with what is known of them", () => {
  expect(beyond(result, { deg: 0.1, mm: 5, ms: 1 })).toEqual([
    "position y ± 5.2 mm",
    "position z ± 20 mm",
    "turn y ± 0.20°",
  ]);
  expect(beyond(result, { deg: 0.2, mm: 20, ms: 0.05 })).toEqual([]);
  expect(beyond(result, { deg: 1, mm: 50, ms: 0.02 })).toEqual(["time offset ± 0.050 ms"]);
  expect(beyond({ uncertainty: null }, { deg: 1, mm: 1, ms: 1 })).toBeNull();
});

test("limits are the server's in its units", () => {
  expect(asLimits({ deg: 0.1, mm: 5, ms: 1 })).toEqual({
    rotation_deg: 0.1,
    translation_m: 0.005,
    time_offset_s: 0.001,
  });
});
