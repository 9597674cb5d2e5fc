import css from "./start.module.css";

/** A room seen from above by a turning lidar: what the sweep smears on the left, the same points put right on it. */
const width = 560;
const height = 250;

function random(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state * 1664525 + 1013904223) % 4294967296;
    return state / 4294967296;
  };
}

/** Where a ray from (x, y) at an angle meets the room's outline. */
function hit(x: number, y: number, angle: number): [number, number] | null {
  const corners: [number, number][] = [
    [40, 24],
    [330, 24],
    [330, 74],
    [520, 74],
    [520, 226],
    [40, 226],
  ];
  const dx = Math.cos(angle);
  const dy = Math.sin(angle);
  let best = Infinity;
  corners.forEach(([ax, ay], i) => {
    const [bx, by] = corners[(i + 1) % corners.length] ?? [0, 0];
    const det = dx * (ay - by) - dy * (ax - bx);
    if (Math.abs(det) < 1e-9) return;
    const t = ((ax - x) * (ay - by) - (ay - y) * (ax - bx)) / det;
    const s = (dx * (ay - y) - dy * (ax - x)) / det;
    if (t > 0 && s >= 0 && s <= 1) best = Math.min(best, t);
  });
  return best === Infinity ? null : [x + dx * best, y + dy * best];
}

function points(smeared: boolean): string {
  const noise = random(7);
  let path = "";
  for (let scan = 0; scan < 9; scan += 1) {
    const turn = Math.sin(scan * 1.9) * 0.3;
    const slide = Math.cos(scan * 2.3) * 26;
    for (let i = 0; i < 150; i += 1) {
      const part = i / 150;
      const wall = hit(250, 135, part * 2 * Math.PI + noise() * 0.04);
      if (wall === null) continue;
      const yaw = smeared ? turn * (part - 0.5) : 0;
      const [dx, dy] = [wall[0] - 250, wall[1] - 135];
      const x =
        250 + dx * Math.cos(yaw) - dy * Math.sin(yaw) + (smeared ? slide * (part - 0.5) : 0) + (noise() - 0.5) * 2;
      const y = 135 + dx * Math.sin(yaw) + dy * Math.cos(yaw) + (noise() - 0.5) * 2.2;
      path += `M${x.toFixed(1)} ${y.toFixed(1)}h0`;
    }
  }
  return path;
}

const raw = points(true);
const straight = points(false);

export function SweepDrawing() {
  return (
    <svg
      className={css.drawing}
      viewBox={`0 0 ${width} ${height}`}
      role="img"
      aria-label="Walls smeared by the motion of the sweep, and the same walls after the motion is taken out"
    >
      <path d={raw} className={css.raw} />
      <path d={straight} className={css.straight} />
      <line x1={width / 2} x2={width / 2} y1="8" y2={height - 8} className={css.wipe} />
      <circle cx="250" cy="135" r="4" className={css.sensor} />
    </svg>
  );
}
