import type { Planes } from "../../api/client";
import { fixed } from "../../ui/format";
import { LevelIcon } from "../../ui/icons";
import css from "./planes.module.css";

const best = 1 / 3;

/** Whether the confirmed planes hold the answer in all three directions, as a sentence and a gauge. */
export function DeterminacyMeter({ determinacy }: { determinacy: Planes["determinacy"] }) {
  const fraction = Math.max(0, Math.min(1, determinacy.smallest_eigenvalue / best));
  return (
    <div className={css.determinacy} data-ok={determinacy.ok} role="status" aria-label="Do these planes determine the answer">
      <LevelIcon level={determinacy.ok ? "good" : "warning"} />
      <p>{determinacy.text}</p>
      <div className={css.gauge} role="img" aria-label={`Weakest direction: ${fixed(fraction * 100, 0)} percent of the best possible`}>
        <span style={{ transform: `scaleX(${fraction})` }} />
      </div>
      <div className={css.gaugeLegend}>
        <span>Weakest direction</span>
        <span className="num">{fixed(fraction * 100, 0)} %</span>
      </div>
    </div>
  );
}
