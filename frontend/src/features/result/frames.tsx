import css from "./result.module.css";

const size = 200;
const middle = size / 2;
const axisLength = 46;

type Vector = readonly [number, number, number];

/** Seen from above the right shoulder: x towards the viewer's left-front, z up. */
function project([x, y, z]: Vector): [number, number] {
  return [-0.55 * x + 0.83 * y, 0.42 * x + 0.28 * y - 0.86 * z];
}

interface FramesProps {
  matrix: readonly (readonly number[])[];
  base: string;
  other: string;
}

/** The two sensors' axes, true in direction; the distance between them is drawn to fit. */
export function Frames({ matrix, base, other }: FramesProps) {
  const at = (row: number, column: number) => matrix[row]?.[column] ?? 0;
  const p: Vector = [at(0, 3), at(1, 3), at(2, 3)];
  const distance = Math.hypot(...p);
  const reach = distance > 1e-6 ? 62 / distance : 0;
  const [ox, oy] = project([p[0] * reach, p[1] * reach, p[2] * reach]);
  const place = (sx: number, sy: number): [number, number] => [middle + sx - ox / 2, middle + 8 + sy - oy / 2];
  const origin = place(0, 0);
  const moved = place(ox, oy);
  const unit: Vector[] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const turned: Vector[] = [0, 1, 2].map((j) => [at(0, j), at(1, j), at(2, j)]);
  return (
    <figure className={css.frames} aria-label={`The ${other}'s axes drawn in the ${base}'s frame, ${(distance * 1000).toFixed(0)} millimetres apart`}>
      <svg viewBox={`0 0 ${size} ${size}`} aria-hidden="true">
        <line x1={origin[0]} y1={origin[1]} x2={moved[0]} y2={moved[1]} className={css.lever} />
        <Axes from={origin} directions={unit} name={base} />
        <Axes from={moved} directions={turned} name={other} />
      </svg>
      <figcaption className="small dim">
        <span className="num">{(distance * 1000).toFixed(1)}</span> mm apart
      </figcaption>
    </figure>
  );
}

function Axes({ from, directions, name }: { from: [number, number]; directions: readonly Vector[]; name: string }) {
  const letters = ["x", "y", "z"] as const;
  // The name stands where no axis points.
  const sum = directions.map(project).reduce(([ax, ay], [bx, by]) => [ax + bx, ay + by], [0, 0]);
  const length = Math.max(0.3, Math.hypot(...sum));
  return (
    <g>
      {directions.map((direction, i) => {
        const [dx, dy] = project(direction);
        const letter = letters[i] ?? "x";
        const [x, y] = [from[0] + dx * axisLength, from[1] + dy * axisLength];
        return (
          <g key={letter} data-axis={letter}>
            <line x1={from[0]} y1={from[1]} x2={x} y2={y} />
            <text x={from[0] + dx * (axisLength + 9)} y={from[1] + dy * (axisLength + 9) + 3}>
              {letter}
            </text>
          </g>
        );
      })}
      <circle cx={from[0]} cy={from[1]} r="3" />
      <text x={from[0] - (sum[0] / length) * 24} y={from[1] - (sum[1] / length) * 17 + 4} className={css.frameName}>
        {name}
      </text>
    </g>
  );
}
