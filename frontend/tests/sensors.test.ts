import { render, screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { createElement } from "react";
import { MemoryRouter } from "react-router";
import { expect, it } from "vitest";
import type { CalibrationResult } from "../src/api/client";
import {
  isOfSensors,
  OwnErrors,
  gyroscopeText,
  parameterName,
  readableIntrinsic,
  toName,
} from "../src/features/result/sensors";

// Fails when a block of one parameter says its name twice.
it("a parameter's name is said once", () => {
  expect(parameterName({ block: "accelerometer_delay", name: "delay" })).toBe("accelerometer delay");
  expect(parameterName({ block: "clock_rate", name: "rate" })).toBe("clock rate");
  expect(parameterName({ block: "range_offset", name: "all" })).toBe("range offset");
  expect(parameterName({ block: "gyroscope_axes", name: "yx" })).toBe("gyroscope axes yx");
  expect(parameterName({ block: "laser_range_offset", name: "34" })).toBe("laser range offset 34");
});

// Fails without the worst of the three; with radians; where the sensors were taken for ideal and nothing is known of it.
it("tells the rotation into the gyroscope's own axes", () => {
  const gyroscope_axes = {
    quaternion_xyzw: [0, 0, -0.7071068, 0.7071068],
    rotation_std_deg: [0.005, 0.0067, 0.0143],
  };
  expect(gyroscopeText({ gyroscope_axes })).toBe(
    " Into the gyroscope\u2019s own axes the rotation is known to 0.014° about any axis: " +
      "x y z w 0.0000000, 0.0000000, -0.7071068, 0.7071068.",
  );
  expect(gyroscopeText({})).toBe("");
});

it("a warning about a sensor stands among the warnings, not beside what was found", () => {
  // Mutations: warnings too; whatever is said.
  expect(isOfSensors({ code: "sensor.laser_range", level: "info" })).toBe(true);
  expect(isOfSensors({ code: "sensor.beyond_sheet", level: "warning" })).toBe(false);
  expect(isOfSensors({ code: "planes.bent", level: "info" })).toBe(false);
});

it("what a filter smears is told in units in which it is no row of zeros", () => {
  // Two poles of 5 ms: 50 ms², 500 ms³. Mutations: as in the file; a thousand for a million.
  const spread = { value: 4.79e-5, std: 1.36e-6, prior_std: 1e-4, unit: "s2" };
  expect(readableIntrinsic(spread)).toEqual({ value: "47.9", sigma: "1.4", prior: "100", unit: "ms²" });
  const skew = { value: -5.01e-7, std: 1.9e-8, prior_std: 4e-6, unit: "s3" };
  expect(readableIntrinsic(skew)).toEqual({ value: "\u2212501", sigma: "19", prior: "4000", unit: "ms³" });
});

// Fails when another sentence is taken for one that asks for a name; when a lidar is to be named where IMUs are.
it("leads to the sensor that is to be named", () => {
  const said = (cure: string) => ({
    code: "sensor.priors",
    text: `error bars are wider, 3.4 times in rotation${cure}`,
  });
  expect(toName(said("; name the IMU to narrow them"))?.control).toBe("imuNoise");
  expect(toName(said("; name the IMU and the lidar to narrow them"))?.control).toBe("imuNoise");
  expect(toName(said("; name the lidar to narrow them"))?.control).toBe("lidar");
  expect(toName(said("; naming the lidar narrows them"))?.control).toBe("lidar"); // of an older version
  expect(toName(said(""))).toBeNull();
  expect(toName({ ...said("; name the IMU to narrow them"), code: "sensor.clock" })).toBeNull();
});

it("every parameter can be seen, and whether it was estimated", async () => {
  // Mutations: the sure ones alone; what was considered left out; half a thousand rows made for nobody.
  const one = { name: "x", unit: "rad", std: 0.001, prior_std: 0.01 };
  const intrinsics = [
    { ...one, block: "gyroscope_axes", value: 0.02, state: "estimated", significant: true },
    { ...one, block: "accelerometer_axes", value: 0.0, state: "considered", significant: false },
  ];
  const result = { messages: [], imu_frame: "", intrinsics } as unknown as CalibrationResult;
  render(createElement(MemoryRouter, null, createElement(OwnErrors, { result, solve: "/" })));
  expect(screen.queryByText("accelerometer axes x")).toBeNull();
  await userEvent.click(screen.getByText("All 2 parameters"));
  expect(await screen.findByText("accelerometer axes x")).toBeDefined();
  expect(screen.getByText("considered")).toBeDefined();
});
