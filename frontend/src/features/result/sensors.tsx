import { useState } from "react";
import { Link } from "react-router";
import type { CalibrationResult } from "../../api/client";
import { stdText, threeDigits } from "../../ui/format";
import css from "./result.module.css";

type Intrinsic = NonNullable<CalibrationResult["intrinsics"]>[number];

/** How a parameter is read: in small units where the file's would be all zeros. */
const readable: Readonly<Record<string, { unit: string; times: number }>> = {
  "1": { unit: "%", times: 100 },
  rad: { unit: "°", times: 180 / Math.PI },
  m: { unit: "mm", times: 1000 },
  s: { unit: "ms", times: 1000 },
  s2: { unit: "ms²", times: 1e6 },
  s3: { unit: "ms³", times: 1e9 },
};

const digits = (value: number) => String(Number(value.toPrecision(2)));

/** Value, sigma and prior of one parameter in the units people read. */
export function readableIntrinsic({
  value,
  std,
  prior_std,
  unit,
}: Pick<Intrinsic, "value" | "std" | "prior_std" | "unit">) {
  const { unit: shown, times } = readable[unit] ?? { unit, times: 1 };
  return {
    value: threeDigits(value * times),
    sigma: digits(std * times),
    prior: digits(prior_std * times),
    unit: shown,
  };
}

/** A parameter in words, without saying twice what its block says, or that there is one for all. */
export function parameterName({ block, name }: Pick<Intrinsic, "block" | "name">) {
  const of = block.replaceAll("_", " ");
  return name === "all" || of.endsWith(` ${name}`) ? of : `${of} ${name}`;
}

/** The rotation into the axes that the lidar sees turn, for software that turns by the gyroscope alone. */
export function gyroscopeText({ gyroscope_axes: axes }: Pick<CalibrationResult, "gyroscope_axes">): string {
  if (axes === null || axes === undefined) return "";
  const quaternion = axes.quaternion_xyzw.map((value) => value.toFixed(7)).join(", ");
  const worst = stdText(Math.max(...axes.rotation_std_deg), "deg");
  return ` Into the gyroscope’s own axes the rotation is known to ${worst} about any axis: x y z w ${quaternion}.`;
}

/** Whether a sentence tells what was found of the sensors themselves. A warning about them stands among the warnings. */
export function isOfSensors({ code, level }: Pick<CalibrationResult["messages"][number], "code" | "level">): boolean {
  return code.startsWith("sensor.") && level !== "warning";
}

/** Which of the sensors has to be named for surer numbers, as the control that does it is called; null where none has. */
export function toName({ code, text }: Pick<CalibrationResult["messages"][number], "code" | "text">) {
  const named = code === "sensor.priors" ? /nam(?:e|ing) the (IMU|lidar)/.exec(text)?.[1] : undefined;
  if (named === undefined) return null;
  return named === "IMU"
    ? { label: "Name the IMU", control: "imuNoise" }
    : { label: "Name the lidar", control: "lidar" };
}

function Parameters({ of, states = false }: { of: readonly Intrinsic[]; states?: boolean }) {
  return (
    <table className={css.compare}>
      <thead>
        <tr>
          <th scope="col">Parameter</th>
          <th scope="col">Found</th>
          <th scope="col">Expected before</th>
          {states && <th scope="col">How</th>}
        </tr>
      </thead>
      <tbody>
        {of.map((one) => {
          const { value, sigma, prior, unit } = readableIntrinsic(one);
          return (
            <tr key={`${one.block}/${one.name}`}>
              <th scope="row">{parameterName(one)}</th>
              <td className="num">
                {value} ± {sigma} {unit}
              </td>
              <td className="num dim">
                0 ± {prior} {unit}
              </td>
              {states && <td className="dim">{one.state}</td>}
            </tr>
          );
        })}
      </tbody>
    </table>
  );
}

/** What the sensors' own errors are found to be, beyond doubt; the sentences first, the numbers for who asks.
 *  solve: address of the form for another run. */
export function OwnErrors({ result, solve }: { result: CalibrationResult; solve: string }) {
  const sentences = result.messages.filter(isOfSensors);
  const every = result.intrinsics ?? [];
  const found = every.filter((one) => one.significant && one.state === "estimated");
  // Behind 128 lasers they are half a thousand rows: made when somebody asks.
  const [open, setOpen] = useState(false);
  if (sentences.length === 0 && every.length === 0) return null;
  return (
    <section aria-label="What the sensors themselves add">
      <h2>What the sensors themselves add</h2>
      {result.imu_frame !== "" && (
        <p className="dim small">
          The IMU&rsquo;s axes here are {result.imu_frame}.{gyroscopeText(result)}
        </p>
      )}
      <ul className={css.bullets}>
        {sentences.map((message) => {
          const name = toName(message);
          return (
            <li key={message.text}>
              {message.text}
              {name !== null && (
                <>
                  {". "}
                  <Link to={`${solve}&known=${name.control}`}>{name.label}</Link>
                </>
              )}
            </li>
          );
        })}
      </ul>
      {found.length > 0 && (
        <details className={css.details}>
          <summary>
            {found.length === 1 ? "The parameter" : `The ${found.length} parameters`} beyond three standard deviations
          </summary>
          <Parameters of={found} />
        </details>
      )}
      {every.length > found.length && (
        <details className={css.details} onToggle={(event) => setOpen(event.currentTarget.open)}>
          <summary>All {every.length} parameters</summary>
          {open && <Parameters of={every} states />}
        </details>
      )}
    </section>
  );
}
