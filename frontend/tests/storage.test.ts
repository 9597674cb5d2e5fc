import { describe, expect, it } from "vitest";
import { sentenceOf } from "../src/features/storage/screen";

const use = {
  disk_total_bytes: 100e9,
  disk_free_bytes: 40e9,
  kept_free_bytes: 1e9,
  used_bytes: 30e9,
  quota_bytes: null,
  keep_days: null,
  recordings: [],
};
const plain = (text: string) => text.replaceAll("\u202f", " ");

describe("what takes room, in words", () => {
  // Fails when the size of a disk that holds other things stands beside what is taken of it, as if the rest were free; when what is
  // held back is counted as room, or a quota that leaves less than the disk does is not looked at.
  it("counts what an upload may take", () => {
    expect(plain(sentenceOf(use))).toContain("take 30.0 GB; there is room for 39.0 GB more.");
    expect(plain(sentenceOf({ ...use, quota_bytes: 35e9 }))).toContain(
      "take 30.0 GB of the 35.0 GB allowed; there is room for 5.0 GB",
    );
    expect(plain(sentenceOf({ ...use, quota_bytes: 20e9 }))).toContain("room for 0 B more");
  });
  it("says how long things stay", () => {
    expect(sentenceOf(use)).toContain("until somebody removes it");
    expect(sentenceOf({ ...use, keep_days: 1 })).toContain("for 1 day is removed");
    expect(sentenceOf({ ...use, keep_days: 30 })).toContain("for 30 days is removed");
  });
});
