import { xyz } from "../../ui/axes";
import { withSigma } from "../../ui/format";
import { LevelIcon } from "../../ui/icons";
import css from "./result.module.css";

const size = 200;
const middle = size / 2;
const axisLength = 54;
const nameAway = 21;

type Vector = readonly [number, number, number];

/** Seen from above the right shoulder: x towards the viewer's left-front, z up. */
function project([x, y, z]: Vector): [number, number] {
  return [-0.55 * x + 0.83 * y, 0.42 * x + 0.28 * y - 0.86 * z];
}

interface FramesProps {
  matrix: readonly (readonly number[])[];
  base: string;
  other: string;
  /** How far apart they are and its standard deviation [m]; null where the recording did not tell. */
  apart: { m: number; sigmaM: number } | null;
  /** Whether that is told, but beyond the limit of a weak answer. */
  weak: boolean;
}

/** The two sensors' axes, true in direction; the distance between them is drawn to fit. */
export function Frames({ matrix, base, other, apart, weak }: FramesProps) {
  const at = (row: number, column: number) => matrix[row]?.[column] ?? 0;
  const p: Vector = [at(0, 3), at(1, 3), at(2, 3)];
  const distance = Math.hypot(...p);
  const told = apart === null ? null : withSigma(apart.m * 1000, apart.sigmaM * 1000, "mm");
  const reach = distance > 1e-6 ? 84 / distance : 0;
  const [ox, oy] = project([p[0] * reach, p[1] * reach, p[2] * reach]);
  const place = (sx: number, sy: number): [number, number] => [middle + sx - ox / 2, middle + 8 + sy - oy / 2];
  const origin = place(0, 0);
  const moved = place(ox, oy);
  const unit: Vector[] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  const turned: Vector[] = [0, 1, 2].map((j) => [at(0, j), at(1, j), at(2, j)]);
  // What a name must not cover: both sets of axes with their letters, and the line between them.
  const marks = [
    ...marksOf(origin, unit),
    ...marksOf(moved, turned),
    ...[0.25, 0.5, 0.75].map((part): Point => [
      origin[0] + part * (moved[0] - origin[0]),
      origin[1] + part * (moved[1] - origin[1]),
    ]),
  ];
  return (
    <figure
      className={css.frames}
      aria-label={`The ${other}'s axes drawn in the ${base}'s frame, ${told === null ? "the distance not known" : `${told.value} ± ${told.sigma} millimetres apart${weak ? ", which is weak" : ""}`}`}
    >
      <svg viewBox={`0 0 ${size} ${size}`} aria-hidden="true">
        <line x1={origin[0]} y1={origin[1]} x2={moved[0]} y2={moved[1]} className={css.lever} />
        <Axes from={origin} directions={unit} />
        <Axes from={moved} directions={turned} />
        <Name at={nameAt(origin, marks)} text={base} />
        <Name at={nameAt(moved, [...marks, nameAt(origin, marks)])} text={other} />
      </svg>
      <figcaption className="small dim">
        {told === null ? (
          "How far apart is not known"
        ) : (
          <>
            <span className="num">
              {told.value} ± {told.sigma}
            </span>{" "}
            mm apart{weak && ", weak"} {weak && <LevelIcon level="warning" size={13} />}
          </>
        )}
      </figcaption>
    </figure>
  );
}

type Point = readonly [number, number];

function marksOf(from: Point, directions: readonly Vector[]): Point[] {
  return directions.flatMap((direction) => {
    const [dx, dy] = project(direction);
    return [0, 0.35, 0.7, 1, 1.17].map((part): Point => [
      from[0] + part * dx * axisLength,
      from[1] + part * dy * axisLength,
    ]);
  });
}

/** The place around a frame's origin that is farthest from everything drawn; wide words need more room to the sides. */
function nameAt(from: Point, marks: readonly Point[]): Point {
  const places = Array.from({ length: 16 }, (_, i): Point => {
    const angle = (i / 16) * 2 * Math.PI;
    return [from[0] + 1.25 * nameAway * Math.cos(angle), from[1] + nameAway * Math.sin(angle)];
  });
  const room = (place: Point) =>
    Math.min(...marks.map((mark) => Math.hypot((mark[0] - place[0]) / 1.5, mark[1] - place[1])));
  return places.reduce((best, place) => (room(place) > room(best) ? place : best));
}

function Name({ at, text }: { at: Point; text: string }) {
  return (
    <text x={at[0]} y={at[1] + 4} className={css.frameName}>
      {text}
    </text>
  );
}

function Axes({ from, directions }: { from: Point; directions: readonly Vector[] }) {
  return (
    <g>
      {directions.map((direction, i) => {
        const [dx, dy] = project(direction);
        const letter = xyz[i] ?? "x";
        return (
          <g key={letter} data-axis={letter}>
            <line x1={from[0]} y1={from[1]} x2={from[0] + dx * axisLength} y2={from[1] + dy * axisLength} />
            <text x={from[0] + dx * (axisLength + 9)} y={from[1] + dy * (axisLength + 9) + 3}>
              {letter}
            </text>
          </g>
        );
      })}
      <circle cx={from[0]} cy={from[1]} r="3" />
    </g>
  );
}
