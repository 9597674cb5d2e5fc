import { SegmentedControl } from "@mantine/core";
import type { CalibrationResult, Limits } from "../../api/client";
import { useOwnLimits } from "../../api/ownlimits";
import { useLimits, useUsualLimits } from "../../api/queries";
import { xyz, type SpaceAxis } from "../../ui/axes";
import { anglesText, fixed, heldText, plusMinus, toSigma, twoDigits, withSigma, type ValueText } from "../../ui/format";
import { distanceOf } from "./distance";
import { Frames } from "./frames";
import { CopyBox } from "./copybox";
import type { Direction, Pose } from "./inverse";
import css from "./result.module.css";

interface PoseCardProps {
  pose: Pose;
  result: CalibrationResult;
  direction: Direction;
  onDirection: (direction: Direction) => void;
}

/** The transform in either direction, the time offset, and one standard deviation of each number. */
export function PoseCard({ pose, result, direction, onDirection }: PoseCardProps) {
  const limits = useLimits();
  // One's own needs may be tighter than what is known; known it is.
  const usual = useUsualLimits();
  const { own } = useOwnLimits();
  const [to, from] = direction === "imu_lidar" ? ["IMU", "lidar"] : ["lidar", "IMU"];
  const offsetS = result.time_offset_s ?? 0;
  const offset =
    result.provenance.settings["estimate_time_offset"] === false
      ? heldText(offsetS * 1000, "ms")
      : withSigma(offsetS * 1000, (result.uncertainty?.time_offset_std_s ?? 0) * 1000, "ms");
  return (
    <section className={css.card} aria-label="The answer">
      <div className={css.cardHead}>
        <SegmentedControl
          size="xs"
          aria-label="Direction of the transform"
          value={direction}
          onChange={(value) => onDirection(value === "lidar_imu" ? "lidar_imu" : "imu_lidar")}
          data={[
            { value: "imu_lidar", label: "T_imu_lidar" },
            { value: "lidar_imu", label: "T_lidar_imu" },
          ]}
        />
        <p className="dim small">
          takes points of the {from} to the {to}: x<sub>{to}</sub> = R x<sub>{from}</sub> + p
        </p>
      </div>
      <div className={css.answer}>
        <table className={css.numbers}>
          <caption className="sr-only">Transform and time offset with one standard deviation</caption>
          <tbody>
            {xyz.map((axis, i) => (
              <NumberRow
                key={axis}
                axis={axis}
                name={`Position ${axis}`}
                text={withSigma((pose.translationM[i] ?? 0) * 1000, (pose.translationStdM[i] ?? 0) * 1000, "mm")}
                share={(pose.translationStdM[i] ?? 0) / limits.translation_m}
              />
            ))}
            <tr>
              <th scope="row">Roll, pitch, yaw</th>
              <td className={`num ${css.angles ?? ""}`} colSpan={2}>
                {anglesText(pose.eulerDeg, pose.rotationStdDeg).join("  ")}
              </td>
              <td className={css.unit}>°</td>
              <td className={css.share} />
            </tr>
            {xyz.map((axis, i) => (
              <NumberRow
                key={`turn ${axis}`}
                axis={axis}
                name={`About ${from} ${axis}`}
                text={{ ...withSigma(0, pose.rotationStdDeg[i] ?? 0, "°"), value: "" }}
                share={(pose.rotationStdDeg[i] ?? 0) / limits.rotation_deg}
              />
            ))}
            <NumberRow
              axis="t"
              name="Time offset"
              text={offset}
              share={(result.uncertainty?.time_offset_std_s ?? 0) / limits.time_offset_s}
            />
          </tbody>
        </table>
        <Frames
          matrix={pose.matrix}
          base={to}
          other={from}
          apart={distanceOf(result)}
          weak={pose.translationStdM.some((std) => std > usual.translation_m)}
        />
      </div>
      <p className="dim small">
        The bar is one standard deviation, the line across it{" "}
        {own === null ? "the limit of a weak answer" : "your own limit"} ({shortLimits(limits)}). R = Rz(yaw) Ry(pitch)
        Rx(roll); how sure it is, turns about the {from}&rsquo;s own axes say. A reading stamped t by the IMU was taken
        at t {offsetS < 0 ? "−" : "+"} {fixed(Math.abs(offsetS) * 1000, 3)} ms of the lidar&rsquo;s clock
        {clockText(result)}.
      </p>
      <div className={css.copies}>
        <CopyBox
          label="the matrix"
          caption="Matrix, last column in metres"
          text={pose.matrix.map((row) => row.map((value) => value.toFixed(7).padStart(10)).join(" ")).join("\n")}
        />
        <CopyBox
          label="translation and quaternion"
          caption="Translation in metres, quaternion x y z w"
          text={`translation_m\n${row(pose.translationM, 6)}\nquaternion_xyzw\n${row(pose.quaternionXyzw, 7)}`}
        />
      </div>
    </section>
  );
}

/** When the offset holds, where the clocks do not run alike. */
function clockText({
  clock_rate_ppm: rate,
  clock_rate_ppm_std: std,
  time_offset_at_s: atS,
}: CalibrationResult): string {
  if (rate == null || atS == null) return "";
  const value = toSigma(rate, std ?? 0);
  return `, ${fixed(atS, 1)} s after the recording began; from there it changes by ${value} ± ${twoDigits(std ?? 0)} µs per second`;
}

/** 20 mm, 0.5°, 2 ms. */
function shortLimits({ translation_m, rotation_deg, time_offset_s }: Limits): string {
  return `${Number((translation_m * 1000).toPrecision(3))} mm, ${Number(rotation_deg.toPrecision(3))}°, ${Number((time_offset_s * 1000).toPrecision(3))} ms`;
}

function row(values: readonly number[], decimals: number): string {
  return values.map((value) => value.toFixed(decimals).padStart(decimals + 3)).join(" ");
}

interface NumberRowProps {
  axis: SpaceAxis | "t";
  name: string;
  text: ValueText;
  /** Standard deviation over the limit of a weak answer. */
  share: number;
}

/** Of the bar's track, how much lies before the limit: what is beyond it shows as beyond. */
const beforeLimit = 0.75;

function NumberRow({ axis, name, text, share }: NumberRowProps) {
  // Not estimated, so that its standard deviation is nobody's finding.
  const held = text.sigma === "held";
  const percent = (part: number) => `${100 * Math.min(1, part * beforeLimit)}%`;
  return (
    <tr>
      <th scope="row" data-axis={axis}>
        {name}
      </th>
      <td className="num">{text.value}</td>
      <td className={`num ${css.sigma ?? ""}`}>{plusMinus(text)}</td>
      <td className={css.unit}>{text.unit}</td>
      <td className={css.share} aria-hidden="true">
        {!held && (
          <span className={css.track}>
            <span data-weak={share > 1} style={{ width: percent(share) }} />
            <i style={{ left: percent(1) }} />
          </span>
        )}
      </td>
    </tr>
  );
}
