import type { CalibrationResult } from "../../api/client";
import { fixed } from "../../ui/format";
import { LinePlot } from "../../ui/lineplot";
import { offsetsOf, plotsOf, type Profile } from "./partsof";
import css from "./result.module.css";

/**
 * What stretches of the recording answer by themselves, and what the turning alone says of the time offset.
 * crossings: how many of their bars cross zero, as the server tells it; of runs of an older version it does not.
 */
export function PartsSection({ result, crossings }: { result: CalibrationResult; crossings: string }) {
  const evidence = result.evidence ?? null;
  if (evidence === null || evidence.parts.time_blocks.length === 0) return null;
  const blocks = evidence.parts.time_blocks;
  const middles = blocks.map((block) => Math.round(50 * (block.t_start_s + block.t_end_s)) / 100);
  const ends = [blocks[0]?.t_start_s ?? 0, blocks.at(-1)?.t_end_s ?? 1] as const;
  return (
    <section aria-label="What parts of the recording answer">
      <h2>Stretch by stretch</h2>
      <p className={css.seen}>
        What each of {blocks.length} stretches would answer alone, minus the answer above; bars are one standard
        deviation, an arrow a point beyond the plot. Two thirds of the bars or more should cross zero, without a trend
        {crossings && `: ${crossings}`}.
      </p>
      <div className={css.parts}>
        {plotsOf(blocks).map((plot) => (
          <LinePlot
            key={plot.name}
            label={plot.name}
            x={middles}
            lines={plot.lines}
            xUnit="s"
            yUnit={plot.unit}
            xRange={ends}
            yRange={plot.range}
            height={150}
          />
        ))}
        {evidence.time_offset_profile && <OffsetProfile profile={evidence.time_offset_profile} />}
      </div>
    </section>
  );
}

function OffsetProfile({ profile }: { profile: Profile }) {
  return (
    <div>
      <LinePlot
        label="Match of the rotation rates, 0 to 1"
        x={offsetsOf(profile)}
        lines={[{ label: "likeness", color: "var(--accent)", values: profile.likeness }]}
        xUnit="ms"
        yUnit=""
        yRange={[0, 1.05]}
        height={150}
      />
      <p className={css.seen}>
        How well the rotation rates of lidar and gyroscope match if the clocks are shifted by so much from the answer:
        one clear peak at zero is good. {profile.text || `The highest is at ${fixed(profile.best_s * 1000, 1)} ms.`}
      </p>
    </div>
  );
}
