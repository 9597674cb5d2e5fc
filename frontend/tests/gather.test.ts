import { describe, expect, it } from "vitest";
import { recordingOf, type FoundFile } from "../src/features/start/gather";
import { tarOf } from "../src/features/start/tar";

const found = (folder: string, ...names: string[]): FoundFile[] =>
  names.map((name) => ({ folder, file: new File([name], name, { lastModified: 1000 }) }));

describe("what was dropped becomes one file", () => {
  it("sends a single bag as it is, whatever lies beside it", () => {
    // Fails with every folder packed.
    expect(recordingOf(found("rig", "metadata.yaml", "rig_0.mcap", "notes.txt")).name).toBe("rig_0.mcap");
    expect(recordingOf(found("", "room.zip")).name).toBe("room.zip");
    expect(recordingOf(found("", "holiday.jpg")).name).toBe("holiday.jpg");
  });

  it("packs the pieces of a split bag, and those that a metadata.yaml holds together", () => {
    expect(recordingOf(found("data/rig", "rig_0.db3", "rig_1.db3")).name).toBe("rig.tar");
    expect(recordingOf(found("data/rig", "a.db3", "b.db3", "metadata.yaml")).name).toBe("rig.tar");
    expect(recordingOf(found("", "walk_0.bag", "walk_1.bag")).name).toBe("walk.tar");
  });

  it("packs the list before the pieces, so that the server sees which are missing, and knows all names", async () => {
    // Fails with the pieces alone; with names that end in .active unknown.
    const packed = recordingOf(found("rig", "a.db3", "b.db3", "metadata.yaml"));
    const text = await packed.text();
    expect([0, 1024, 2048].map((at) => text.slice(at, at + 13).replaceAll("\0", ""))).toEqual([
      "metadata.yaml",
      "a.db3",
      "b.db3",
    ]);
    expect(recordingOf(found("rig", "walk.bag.active", "notes.txt")).name).toBe("walk.bag.active");
    expect(recordingOf(found("", "room.tar.bz2", "notes.txt")).name).toBe("room.tar.bz2");
  });

  it("refuses several recordings, and none", () => {
    // Fails with folders not compared: two bags of one name would be glued together.
    expect(() => recordingOf([...found("a", "x_0.bag"), ...found("b", "x_1.bag")])).toThrow("2 recordings (a, b)");
    expect(() => recordingOf(found("", "monday.bag", "tuesday.bag"))).toThrow("2 recordings");
    expect(() => recordingOf(found("photos", "a.jpg", "b.jpg"))).toThrow("The folder photos holds no .bag");
  });
});

describe("the archive", () => {
  it("is found again by name, size and time", () => {
    // Fails with the time of packing: an interrupted upload of the same folder would begin anew.
    const pack = () =>
      tarOf(
        "rig.tar",
        found("", "a.bag", "b.bag").map(({ file }) => ({ name: file.name, file })),
      );
    const [one, again] = [pack(), pack()];
    expect([one.size, one.lastModified]).toEqual([again.size, again.lastModified]);
    expect(one.size % 512).toBe(0);
  });

  it("writes sizes beyond eight gigabytes in binary", async () => {
    // Oracle: the number, from its bytes. Fails with twelve octal digits, which overflow into the time.
    const big = new File([], "big.bag");
    Object.defineProperty(big, "size", { value: 9 * 1024 ** 3 + 512 });
    const header = new Uint8Array(
      await tarOf("x.tar", [{ name: "big.bag", file: big }])
        .slice(0, 512)
        .arrayBuffer(),
    );
    expect(header[124]).toBe(0x80);
    expect(header.slice(125, 136).reduce((sum, byte) => sum * 256 + byte, 0)).toBe(9 * 1024 ** 3 + 512);
    const sum = header.reduce((all, byte, at) => all + (at >= 148 && at < 156 ? 32 : byte), 0);
    expect(parseInt(new TextDecoder().decode(header.slice(148, 154)), 8)).toBe(sum);
  });
});
