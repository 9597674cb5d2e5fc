import { expect, test } from "vitest";
import { limitsOf, limitsText } from "../src/features/audit/limits";
import { listed, standingOf } from "../src/features/start/standing";
import type { Recording } from "../src/api/client";

const usual = limitsText({ rotation_deg: 0.5, translation_m: 0.02, time_offset_s: 0.002 });

/** Oracle: the served limits in the fields' own units. Mutations: metres shown as millimetres; Infinity typed. */
test("limits that nobody chose are the served ones, and none until these are told", () => {
  expect(usual).toEqual({ rotation: "0.5", translation: "20", time: "2" });
  const untold = limitsText({ rotation_deg: Infinity, translation_m: Infinity, time_offset_s: Infinity });
  expect(untold).toEqual({ rotation: "", translation: "", time: "" });
});

/** Mutations: three numbers read as one; an empty field read as nought; a comma taken for a separator. */
test("limits are one number, three, or nothing where it is not judged", () => {
  expect(limitsOf(usual)).toEqual({ rotation_deg: 0.5, translation_mm: 20, time_offset_ms: 2 });
  expect(limitsOf({ rotation: "", translation: "10 10 30", time: "1,5" })).toEqual({
    rotation_deg: null,
    translation_mm: [10, 10, 30],
    time_offset_ms: 1.5,
  });
});

test("what is no limit is refused before it is sent", () => {
  for (const translation of ["0", "-3", "1 2", "1 2 3 4", "a", "10 10 x"]) {
    expect(limitsOf({ ...usual, translation })).toBeNull();
  }
  expect(limitsOf({ ...usual, time: "1 1 1" })).toBeNull();
  expect(limitsOf({ rotation: "", translation: " ", time: "" })).toBeNull();
});

function recording(verdict: "passed" | "failed"): Recording {
  return {
    id: verdict,
    name: verdict,
    size_bytes: 1,
    created_at: "2026-01-01T00:00:00Z",
    state: "ready",
    verdict: "good",
    latest_job: { kind: "audit", state: "done", result: { kind: "audit", verdict, text: "" } },
  } as unknown as Recording;
}

test("a recording that was only audited stands at its audit", () => {
  expect(standingOf(recording("failed"))).toEqual({ tone: "error", text: "Audit failed", screen: "audit" });
  expect(listed([recording("passed"), recording("failed")], "audit failed", "name")).toHaveLength(1);
});
