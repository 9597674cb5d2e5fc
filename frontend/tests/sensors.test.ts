import { expect, it } from "vitest";
import { parameterName } from "../src/features/result/sensors";

// Fails when a block of one parameter says its name twice.
it("a parameter's name is said once", () => {
  expect(parameterName({ block: "accelerometer_delay", name: "delay" })).toBe("accelerometer delay");
  expect(parameterName({ block: "clock_rate", name: "rate" })).toBe("clock rate");
  expect(parameterName({ block: "range_offset", name: "all" })).toBe("range offset");
  expect(parameterName({ block: "gyroscope_axes", name: "yx" })).toBe("gyroscope axes yx");
  expect(parameterName({ block: "laser_range_offset", name: "34" })).toBe("laser range offset 34");
});
