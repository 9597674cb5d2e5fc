import { describe, expect, it } from "vitest";
import openapi from "../openapi.json";
import { fixOf, fixText, isOffered } from "../src/features/recording/fixes";
import { dragged, moved } from "../src/features/recording/span";
import { parseNudge, nudgeAxes, stepped, wallsAreSilent, writeNudge, noNudge } from "../src/features/inspect/nudges";
import { addSample, rateOf, type RateSample } from "../src/features/start/rate";
import {
  ago,
  bytes,
  duration,
  fixed,
  foreseenText,
  heldText,
  NARROW,
  percentOf,
  plusMinus,
  stdText,
  threeDigits,
  withSigma,
} from "../src/ui/format";
import { keycaps } from "../src/ui/keys";
import { controlName } from "../src/ui/words";

describe("numbers for people", () => {
  // Fails when decimals are counted from the value instead of from the standard deviation, or before that is rounded.
  it("gives a value the decimals its standard deviation deserves", () => {
    expect(withSigma(103.7261, 0.632, "mm")).toEqual({ value: "103.73", sigma: "0.63", unit: "mm" });
    expect(withSigma(103.7261, 17, "mm")).toEqual({ value: "104", sigma: "17", unit: "mm" });
    expect(withSigma(103.7261, 0.996, "°")).toEqual({ value: "103.7", sigma: "1.0", unit: "°" });
    expect(withSigma(-0.00001, 0.3, "ms")).toEqual({ value: "0.00", sigma: "0.30", unit: "ms" });
    expect(withSigma(-0.00001, 0, "ms").sigma).toBe("0");
  });

  // Oracle: calib_core/sigmas.py, of which tests/core/test_sigmas.py has the same numbers. Fails when a table has a unit or digits
  // of its own: "> 1000 mm" beside a sentence with 9.1 m.
  it("says a wide standard deviation in one way, in a table and in a sentence", () => {
    expect(withSigma(-310.2, 9135.06, "mm")).toEqual({ value: "−0.3", sigma: "9.1", unit: "m" });
    expect(withSigma(12.3, 10000, "ms")).toEqual({ value: "0", sigma: "10", unit: "s" });
    expect(withSigma(12.3, 190, "°")).toEqual({ value: "12", sigma: "not determined", unit: "°" });
    expect(plusMinus(withSigma(12.3, 190, "°"))).toBe("not determined");
    expect(plusMinus(withSigma(12.3, 0.2, "°"))).toBe("± 0.20");
    expect(plusMinus(heldText(12.3, "mm"))).toBe("held");
    expect(
      (
        [
          [0.02, "deg"],
          [179.9, "deg"],
          [180, "deg"],
          [0.00086, "m"],
          [0.9994, "m"],
          [1, "m"],
          [9.13506, "m"],
          [25.4e-6, "s"],
          [10, "s"],
        ] as const
      ).map(([std, unit]) => stdText(std, unit)),
    ).toEqual(["0.020°", "180°", "not determined", "0.86 mm", "999 mm", "1.0 m", "9.1 m", "0.025 ms", "10 s"]);
    expect(foreseenText(9.13, "m", true)).toBe("unknown");
    expect(foreseenText(0.5, "m", true)).toBe(`±${NARROW}500 mm`);
  });

  // Fails when the unit is chosen before rounding.
  it("never shows 1000 of a unit", () => {
    expect(bytes(999_900)).toBe("1.0\u202fMB");
    expect(bytes(127_600_000)).toBe("128\u202fMB");
    expect(fixed(-1.5, 1)).toBe("−1.5");
  });
});

describe("durations and shares", () => {
  const told = (seconds: number) => duration(seconds).replaceAll(NARROW, " ");

  // Mutations: seconds or minutes rounded after they were taken apart, as "1 min 60 s" and "1 h 60 min" were.
  it("carry what is rounded up", () => {
    expect([9.94, 9.95, 99.4, 99.5, 119.4, 119.6, 3599.4, 3599.6, 7199, 7170.1, 7169.9].map(told)).toEqual([
      "9.9 s",
      "10 s",
      "99 s",
      "1 min 40 s",
      "1 min 59 s",
      "2 min 00 s",
      "59 min 59 s",
      "1 h 00 min",
      "2 h 00 min",
      "2 h 00 min",
      "1 h 59 min",
    ]);
  });

  // Oracle: the text read back. Mutation: any of the formatters that rounds after it has chosen a unit.
  it("say what is meant to half of their last digit, and no unit more than it holds", () => {
    for (let seconds = 0; seconds < 90_000; seconds += 0.05 + seconds / 997) {
      const text = told(seconds);
      const [, hours, minutes, rest] = /^(?:(\d+) h )?(?:(\d+) min ?)?(?:([\d.]+) s)?$/.exec(text) ?? [];
      const read = 3600 * Number(hours ?? 0) + 60 * Number(minutes ?? 0) + Number(rest ?? 0);
      expect(Math.abs(read - seconds), text).toBeLessThanOrEqual(hours !== undefined ? 30.01 : 0.51);
      if (minutes !== undefined) expect(Number(minutes), text).toBeLessThan(60);
      if (minutes !== undefined) expect(Number(rest ?? 0), text).toBeLessThan(60);
    }
    for (let n = 1; n < 1e14; n *= 1.00317) {
      expect(Number.parseFloat(bytes(n)), bytes(n)).toBeLessThan(1000);
    }
    const now = Date.UTC(2026, 0, 1);
    for (let seconds = 1; seconds < 3e8; seconds *= 1.0117)
      expect(ago(now - seconds * 1000, now)).not.toMatch(/^(6\d minutes|2[4-9] hours|3[1-9] days|1[2-9] months) ago/);
  });

  // Mutations: 100 % of what is under way; 1.00e+3 for 999.6; decimals by the number before it is rounded.
  it("claim no more than is done, and write numbers out", () => {
    expect([0, 0.29, 0.995, 0.9999, 1].map(percentOf)).toEqual([0, 29, 99, 99, 100]);
    expect([999.6, 1234, 9.996, 0.09996, -501, 0, 1.2345e-5].map(threeDigits)).toEqual([
      "1000",
      "1234",
      "10.0",
      "0.100",
      "−501",
      "0.00",
      "0.0000123",
    ]);
  });
});

describe("fixes", () => {
  // Fails when only the first option of an override is read, or when an unknown one is sent on.
  it("turns an override into the change it stands for, or into nothing", () => {
    expect(fixOf("--point-time-field t --point-time-unit ns")).toEqual({
      point_time_field: "t",
      point_time_unit: "ns",
    });
    expect(fixOf("--synthesise-point-time")).toEqual({ synthesise_point_time: true });
    expect(fixOf("--range-max-m 60")).toEqual({ range_max_m: 60 });
    expect(fixOf("--imu-noise vn100")).toBeNull();
    expect(fixOf("--stamps")).toBeNull();
    expect(fixOf("")).toBeNull();
  });

  // Fails when a recording in g, which its norm at rest is beyond doubt of, has a button that makes it unreadable; when somebody who
  // asked for the wrong unit has none; when a doubtful finding, or a warning of something else, has none.
  it("is offered where there is something to put right", () => {
    const inG = {
      code: "imu.accelerometer_unit",
      level: "warning",
      confidence: 1,
      override: "--accelerometer-unit m_s2",
    } as const;
    const asFound = { accelerometer_unit: null, gyroscope_unit: null };
    expect(isOffered(inG, asFound)).toBe(false);
    expect(isOffered(inG, { ...asFound, accelerometer_unit: "g" })).toBe(true);
    expect(isOffered(inG, { ...asFound, gyroscope_unit: "deg_s" })).toBe(false);
    expect(isOffered({ ...inG, confidence: 0.4 }, asFound)).toBe(true);
    expect(isOffered({ ...inG, code: "stamps.late", override: "--stamps receive" }, asFound)).toBe(true);
    expect(isOffered({ ...inG, code: "stamps.late", level: "info", override: "--stamps receive" }, asFound)).toBe(
      false,
    );
    expect(isOffered({ ...inG, confidence: 0.4, override: "" }, asFound)).toBe(false);
  });

  // Fails when an option's name or value reaches the button as the command line has it; when a switch is set to nothing.
  it("names the control that a fix sets, and its value, in the page's words", () => {
    expect(fixText("--gyroscope-unit deg_s")).toBe("Set “Gyroscope unit” to °/s");
    expect(fixText("--imu-bundles as-stamped")).toBe(`Set “${controlName("imu-bundles")}” to as stamped`);
    expect(fixText("--repeated-returns as-sent")).toBe("Set “Returns that are there twice” to as sent");
    expect(fixText("--point-time-field t --point-time-unit ns")).toBe(
      "Set “Point time field” to t, set “Point time unit” to ns",
    );
    expect(fixText("--synthesise-point-time")).toBe("Switch on “Make up point times”");
  });
});

describe("the span", () => {
  // Fails when a drag to the left keeps its first point as the start.
  it("does not depend on the drag's direction and never gets too short", () => {
    expect(dragged(8, 3, 20, 1)).toEqual({ startS: 3, endS: 8 });
    expect(dragged(19.8, 20, 20, 1)).toEqual({ startS: 19, endS: 20 });
    expect(moved({ startS: 3, endS: 8 }, "start", 7.9, 20, 1)).toEqual({ startS: 7, endS: 8 });
    expect(moved({ startS: 3, endS: 8 }, "end", 99, 20, 1)).toEqual({ startS: 3, endS: 20 });
  });

  // Fails when a page has a shortest span of its own.
  it("is as short as the server says, where the recording is as long", () => {
    expect(dragged(19.8, 20, 20, 2)).toEqual({ startS: 18, endS: 20 });
    expect(moved({ startS: 3, endS: 8 }, "start", 7.9, 20, 2)).toEqual({ startS: 6, endS: 8 });
    expect(dragged(0.2, 0.3, 0.5, 2)).toEqual({ startS: 0, endS: 0.5 });
  });
});

describe("nudges", () => {
  // Oracle: the server's own document, as a link's nudge is read before the server is asked. Fails when a bound is another there.
  it("go as far as the server takes them", () => {
    for (const { key, most } of nudgeAxes) {
      const { minimum, maximum } = openapi.components.schemas.Nudge.properties[key];
      expect([minimum, maximum]).toEqual([-most, most]);
    }
  });

  // Fails when the clock's step is taken in milliseconds.
  it("survive the way through the URL, free of binary dust", () => {
    const clock = nudgeAxes.find((axis) => axis.key === "dt_s");
    const turn = nudgeAxes.find((axis) => axis.key === "rz_deg");
    if (clock === undefined || turn === undefined) throw new Error("axes are missing");
    let nudge = noNudge;
    for (let i = 0; i < 3; i += 1) nudge = stepped(nudge, clock, -1);
    nudge = stepped(nudge, turn, 2);
    expect(writeNudge(nudge)).toBe("rz_deg:2,dt_s:-0.003");
    expect(parseNudge(writeNudge(nudge))).toEqual(nudge);
    expect(parseNudge("rz_deg:1e9,evil:3,tx_m:x")).toEqual({ ...noNudge, rz_deg: 30 });
  });
});

describe("an error that the walls do not show", () => {
  // Seen: a shift by 1 cm left walls 14.7 mm thick beside an error bar of 0.5 mm, without a word. Fails when a turn counts as a shift;
  // when what the walls do show is said to be hardly any.
  it("is one of position alone", () => {
    const blur = (mm: number) => ({ solved_rms_m: 0.0147, nudged_rms_m: 0.0147 + mm / 1000 });
    const shift = { ...noNudge, tz_m: 0.01 };
    expect(wallsAreSilent(shift, blur(0.04))).toBe(true);
    expect(wallsAreSilent(shift, blur(0.3))).toBe(false);
    expect(wallsAreSilent({ ...shift, rx_deg: 1 }, blur(0.04))).toBe(false);
    expect(wallsAreSilent({ ...noNudge, dt_s: 0.001 }, blur(0.04))).toBe(false);
    expect(wallsAreSilent(noNudge, blur(0))).toBe(false);
  });
});

describe("keycaps", () => {
  // Fails when the key that joins others has an empty cap.
  it("has one for plus", () => {
    expect(keycaps("+")).toEqual(["+"]);
    expect(keycaps("shift+ArrowLeft")).toEqual(["Shift", "←"]);
  });
});

describe("upload speed", () => {
  // Fails when the average over the whole upload is shown instead of the last seconds.
  it("is that of the last seconds", () => {
    let samples: RateSample[] = [];
    for (let s = 0; s <= 20; s += 1)
      samples = addSample(samples, { atMs: s * 1000, bytes: s < 10 ? s : 10 + (s - 10) * 1e6 });
    const rate = rateOf(samples, 30e6);
    expect(rate.bytesPerSecond).toBeCloseTo(1e6, -3);
    expect(rate.secondsLeft).toBeCloseTo(20, 1);
    expect(rateOf([], 5).bytesPerSecond).toBeNull();
  });
});
