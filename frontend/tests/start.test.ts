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

  // Fails when an upload whose page was closed is called one that goes on, and a sample one that is sent.
  it("tells how much is here, whoever sends it", () => {
    const coming = (origin: Recording["origin"], here: number) =>
      ({ state: "receiving", origin, received_bytes: here, size_bytes: 1000 }) as Recording;
    expect(standingOf(coming("upload", 439)).text).toBe("Upload at 43 %");
    expect(standingOf({ ...coming("upload", 0), size_bytes: 0 }).text).toBe("Upload at 0 %");
    expect(standingOf(coming("sample", 0)).text).toBe("Being made");
  });
});
