import { describe, expect, it } from "vitest";
import type { Job, Recording } from "../src/api/client";
import { standingOf } from "../src/features/start/standing";

const solving = (state: Job["state"]) =>
  ({ state: "ready", latest_job: { kind: "solve", state, result: null } }) as unknown as Recording;

describe("where a recording stands", () => {
  // Fails when every solve without an answer counts as one that runs.
  it("does not call a stopped solve solving", () => {
    expect(standingOf(solving("running")).text).toBe("Solving");
    expect(standingOf(solving("cancelled")).text).toBe("Solve cancelled");
    expect(standingOf(solving("interrupted")).text).toBe("Solve interrupted");
    expect(standingOf(solving("failed")).tone).toBe("error");
  });
});
