import { describe, expect, it } from "vitest";
import openapi from "../openapi.json";
import { axes, axisNames, perUnit, unitOf } from "../src/ui/axes";

describe("the seven of a calibration", () => {
  // Fails when two of them change places: priors would be offered, and answers listed, in another order than the document's.
  it("come in the order of the API's document", () => {
    expect(axes).toEqual(openapi.components.schemas.AxisAudit.properties.axis.enum);
  });

  // Fails when an angle is told in millimetres, or a lateness in metres.
  it("are told in the units that people read", () => {
    expect(axes.map(unitOf)).toEqual(["°", "°", "°", "mm", "mm", "mm", "ms"]);
    expect(perUnit("rz") * Math.PI).toBeCloseTo(180);
    expect([perUnit("tx"), perUnit("dt")]).toEqual([1000, 1000]);
    expect(axisNames.tz).toContain("IMU’s z");
  });
});
