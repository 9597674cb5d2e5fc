import { Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import type { Thickness, WallThickness } from "../../api/client";
import { thicknessQuery } from "../../api/queries";
import { count, fixed } from "../../ui/format";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import { Histogram } from "./histogram";
import css from "./inspect.module.css";

interface Looks {
  colors: ReadonlyMap<string, string>;
  /** What a plane of the run is called today. */
  names: ReadonlyMap<string, string>;
}

/** Wall thickness before and after: the one number that shows whether the motion is gone. */
export function ThicknessSection({ jobId, ...looks }: Looks & { jobId: string }) {
  const thickness = useQuery(thicknessQuery(jobId));
  return (
    <Section title="Wall thickness" tools={<span className="dim small">rms of points about their plane, mm</span>}>
      {thickness.isPending ? (
        <div role="status" aria-busy="true" aria-label="Measuring the walls">
          <Skeleton height={46} mb={10} />
          <Skeleton height={120} mb={10} />
          <Skeleton height={96} />
        </div>
      ) : thickness.isError ? (
        <Fault error={thickness.error} onRetry={() => void thickness.refetch()} />
      ) : (
        <Walls thickness={thickness.data} {...looks} />
      )}
    </Section>
  );
}

function Walls({ thickness, colors, names }: Looks & { thickness: Thickness }) {
  const nameOf = (name: string) => names.get(name) ?? name;
  const [chosen, setChosen] = useState<string | null>(null);
  const wall = thickness.walls.find((one) => one.name === chosen);
  const most = Math.max(1e-6, ...thickness.walls.flatMap((one) => [one.before_rms_m, one.after_rms_m]));
  const total = wall ?? allWalls(thickness);
  return (
    <>
      <p className={css.headline}>
        <span className={`num ${css.before ?? ""}`}>{fixed(total.before_rms_m * 1000, 1)}</span>
        <span className={css.arrow} aria-label="to">
          →
        </span>
        <span className={`num ${css.after ?? ""}`}>{fixed(total.after_rms_m * 1000, 1)}</span>
        <span className={css.mm}>mm</span>
        <span className={css.scope}>{wall === undefined ? "all walls" : nameOf(wall.name)}</span>
      </p>
      <Histogram edgesM={thickness.edges_m} before={total.before_histogram} after={total.after_histogram} />
      <ul className={css.walls} aria-label="Walls">
        {thickness.walls.map((one) => (
          <li key={one.name}>
            <button
              type="button"
              aria-pressed={one.name === chosen}
              onClick={() => setChosen(one.name === chosen ? null : one.name)}
              title={`${count(one.points)} points; click for its histogram`}
            >
              <span className={css.swatch} style={{ background: colors.get(one.name) ?? "var(--ink-3)" }} />
              <span className="clip">{nameOf(one.name)}</span>
              <span className={css.pair}>
                <i data-which="before" style={{ width: `${(100 * one.before_rms_m) / most}%` }} />
                <i data-which="after" style={{ width: `${(100 * one.after_rms_m) / most}%` }} />
              </span>
              <span className="num">
                <span className="dim">{fixed(one.before_rms_m * 1000, 1)}</span> {fixed(one.after_rms_m * 1000, 1)}
              </span>
            </button>
          </li>
        ))}
      </ul>
    </>
  );
}

function addUp(columns: readonly (readonly number[])[]): number[] {
  return (columns[0] ?? []).map((_, i) => columns.reduce((sum, column) => sum + (column[i] ?? 0), 0));
}

function allWalls(thickness: Thickness): Omit<WallThickness, "name" | "points"> {
  return {
    before_rms_m: thickness.before_rms_m,
    after_rms_m: thickness.after_rms_m,
    before_histogram: addUp(thickness.walls.map((wall) => wall.before_histogram)),
    after_histogram: addUp(thickness.walls.map((wall) => wall.after_histogram)),
  };
}
