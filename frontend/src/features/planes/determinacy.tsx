import type { Planes } from "../../api/client";
import { foreseenText } from "../../ui/format";
import { LevelIcon } from "../../ui/icons";
import css from "./planes.module.css";

/** The gauge is full where the weakest axis is a thousand times better known than it has to be. */
const decades = 3;

type Known = Pick<Planes, "determinacy" | "foreseen">;

interface MeterProps extends Known {
  /** Why no planes at all would help; empty where they may. */
  hopeless: string;
  /** Why nothing is foreseen of a solve with these planes; empty where something is. */
  caution: string;
}

/** Whether the confirmed planes hold the answer in all three directions, and how well the least known axis is foreseen. */
export function DeterminacyMeter({ determinacy, foreseen, hopeless, caution }: MeterProps) {
  const known = caution === "" ? (foreseen ?? null) : null;
  const ok = hopeless === "" && caution === "" && determines({ determinacy, foreseen });
  const fraction = strength(known);
  const text = known === null ? "" : foreseenText(known.std, known.unit, known.weak);
  return (
    <div className={css.determinacy} data-ok={ok} role="status" aria-label="Do these planes determine the answer">
      <LevelIcon level={ok ? "good" : "warning"} />
      <p>
        {determinacy.text} {[hopeless, caution, known?.text].find((words) => words !== undefined && words !== "")}
      </p>
      {known !== null && (
        <>
          <div className={css.gauge} role="img" aria-label={`Least known axis as foreseen: ${known.name}, ${text}`}>
            <span style={{ transform: `scaleX(${fraction})` }} />
          </div>
          <div className={css.gaugeLegend}>
            <span>Least known, foreseen: {known.name}</span>
            <span className="num">{text}</span>
          </div>
        </>
      )}
    </div>
  );
}

/** Whether a solve with the confirmed planes would know all seven axes. */
export function determines({ determinacy, foreseen }: Known): boolean {
  return determinacy.ok && foreseen?.weak !== true;
}

/** How far the weakest axis is below its limit, 0..1 on a logarithmic scale: it falls whenever its sigma grows. */
export function strength(foreseen: Planes["foreseen"]): number {
  if (foreseen === null || foreseen === undefined) return 0;
  return Math.max(0.02, Math.min(1, -Math.log10(foreseen.std / foreseen.limit) / decades));
}
