import type { AxisAudit } from "../api/client";

/** The seven of a calibration, by the names that the API's document has for them. */
export type Axis = AxisAudit["axis"];

/** What each is, in full. A name that the API does not know, or one too few, is no program. */
export const axisNames: Readonly<Record<Axis, string>> = {
  rx: "Turn about the lidar’s x",
  ry: "Turn about the lidar’s y",
  rz: "Turn about the lidar’s z",
  tx: "Position along the IMU’s x",
  ty: "Position along the IMU’s y",
  tz: "Position along the IMU’s z",
  dt: "Time offset",
};

/** All of them, in the covariance's order. */
export const axes = Object.keys(axisNames) as readonly Axis[];

/** The unit that people read it in. */
export function unitOf(axis: Axis): "°" | "mm" | "ms" {
  return axis.startsWith("r") ? "°" : axis === "dt" ? "ms" : "mm";
}

/** How many of a person's units the document's is: degrees to a radian, millimetres to a metre, milliseconds to a second. */
export function perUnit(axis: Axis): number {
  return axis.startsWith("r") ? 180 / Math.PI : 1000;
}

/** The three of space. */
export const xyz = ["x", "y", "z"] as const;
export type SpaceAxis = (typeof xyz)[number];

/** What plots draw each of them in. */
export function colorOf(axis: SpaceAxis): string {
  return `var(--axis-${axis})`;
}
