import { xyz, type SpaceAxis } from "../../ui/axes";
import css from "./guide.module.css";
import type { Platform } from "./texts";

interface MotionPictureProps {
  platform: Platform;
  good: boolean;
  text: string;
}

/** A rig in a room with the way it is moved, and below what its gyroscope reads then. */
export function MotionPicture({ platform, good, text }: MotionPictureProps) {
  return (
    <figure className={css.picture} data-good={good}>
      <svg viewBox="0 0 300 196" role="img" aria-label={`${good ? "Good" : "Bad"}: ${text}`}>
        <Room />
        <g transform="translate(150 74)">
          {good ? <Turns platform={platform} /> : <Straight platform={platform} />}
          <Rig platform={platform} />
        </g>
        <Rates good={good} platform={platform} />
      </svg>
      <figcaption>
        <strong>{good ? "Like this" : "Not like this"}</strong>
        <span>{text}</span>
      </figcaption>
    </figure>
  );
}

function Room() {
  return (
    <g className={css.room}>
      <path d="M20 118L150 62L280 118" />
      <path d="M150 62V6M20 118V30M280 118V30" />
    </g>
  );
}

function Rig({ platform }: { platform: Platform }) {
  switch (platform) {
    case "hand":
      return (
        <g className={css.rig}>
          <rect x="-4" y="8" width="8" height="26" rx="3" />
          <rect x="-13" y="-6" width="26" height="15" rx="3" />
          <rect x="-9" y="-18" width="18" height="13" rx="4" className={css.lidar} />
        </g>
      );
    case "car":
      return (
        <g className={css.rig}>
          <path d="M-44 22V8l12-3 10-13h34l13 13 17 3v14z" />
          <circle cx="-25" cy="23" r="7" />
          <circle cx="25" cy="23" r="7" />
          <rect x="-8" y="-19" width="16" height="11" rx="3" className={css.lidar} />
        </g>
      );
    case "drone":
      return (
        <g className={css.rig}>
          <path d="M-40 -6H40M-40 -6v-6M40 -6v-6" className={css.arm} />
          <ellipse cx="-40" cy="-14" rx="17" ry="3" />
          <ellipse cx="40" cy="-14" rx="17" ry="3" />
          <rect x="-14" y="-10" width="28" height="14" rx="4" />
          <rect x="-8" y="5" width="16" height="12" rx="4" className={css.lidar} />
        </g>
      );
  }
}

const head = "l-6 -1.500m6 1.500l-1.500 6";

/** Arrows round the three axes; a car gets its own from an eight with a ramp in it. */
function Turns({ platform }: { platform: Platform }) {
  if (platform === "car") {
    return (
      <g className={css.way}>
        <path d="M0 30C-30 8 -92 14 -92 32S-30 54 0 30S92 8 92 30S30 54 0 30" data-axis="z" />
        <path d="M64 44l16 -8 16 8z" className={css.ramp} />
        <path d="M-62 -2a34 22 0 0 1 20 -22" data-axis="y" />
        <path d={`M-42 -24${head}`} data-axis="y" />
      </g>
    );
  }
  return (
    <g className={css.way}>
      <path d="M-52 6a52 17 0 0 0 104 0" data-axis="z" />
      <path d="M52 6l-5 5m5 -5l3 6" data-axis="z" />
      <path d="M-30 -34a38 38 0 0 1 60 0" data-axis="x" />
      <path d="M30 -34l-7 -1m7 1l0 -7" data-axis="x" />
      <path d="M62 -30a40 40 0 0 1 0 46" data-axis="y" />
      <path d="M62 16l0 -7m0 7l7 -2" data-axis="y" />
    </g>
  );
}

function Straight({ platform }: { platform: Platform }) {
  const y = platform === "car" ? 40 : platform === "hand" ? 44 : -30;
  return (
    <g className={css.way}>
      <path d={`M-96 ${y}H92`} strokeDasharray="5 5" data-axis="none" />
      <path d={`M92 ${y}l-8 -5m8 5l-8 5`} data-axis="none" />
    </g>
  );
}

const left = 20;
const width = 260;
const middle = 160;
const stillShare = 0.12;

/** Rate of turn over time, three axes: what the Recording screen shows of such a motion. */
function Rates({ good, platform }: { good: boolean; platform: Platform }) {
  return (
    <g className={css.rates}>
      <rect x={left} y={middle - 26} width={width} height={52} rx={3} />
      <line x1={left} x2={left + width} y1={middle} y2={middle} />
      {xyz.map((axis, i) => (
        <polyline key={axis} points={curve(i, sizeOf(axis, good, platform))} data-axis={axis} />
      ))}
    </g>
  );
}

function sizeOf(axis: SpaceAxis, good: boolean, platform: Platform): number {
  if (!good) return axis === "z" ? 3.5 : 0.8;
  return platform === "car" && axis !== "z" ? 9 : 20;
}

/** Still at first; then three motions of different rhythm. */
function curve(place: number, size: number): string {
  const rhythm = [5.2, 6.7, 4.3][place] ?? 5;
  return Array.from({ length: 131 }, (_, i) => {
    const share = i / 130;
    const moving = Math.max(0, Math.min(1, (share - stillShare) / 0.06));
    const rate = moving * size * Math.sin(2 * Math.PI * rhythm * (share - stillShare) + place);
    return `${(left + share * width).toFixed(1)},${(middle - rate).toFixed(1)}`;
  }).join(" ");
}
