import type { DoctorReport } from "../../api/client";
import { colorOf, xyz } from "../../ui/axes";
import { LinePlot } from "../../ui/lineplot";
import css from "./recording.module.css";

/** The readings behind the report. */
export function Evidence({ timeline }: { timeline: DoctorReport["timeline"] }) {
  const perAxis = (columns: readonly (readonly number[])[]) =>
    xyz.map((axis, i) => ({ label: axis, color: colorOf(axis), values: columns[i] ?? [] }));
  const steps = timeline.scan_t_s.slice(1).map((t, i) => (t - (timeline.scan_t_s[i] ?? t)) * 1000);
  return (
    <section className={css.plots} aria-label="Readings">
      {timeline.t_s.length > 0 && (
        <>
          <LinePlot
            label="Rate of turn"
            x={timeline.t_s}
            lines={perAxis(timeline.rotation_deg_s)}
            xUnit="s"
            yUnit="°/s"
            height={130}
          />
          <LinePlot
            label="Acceleration"
            x={timeline.t_s}
            lines={perAxis(timeline.acceleration_m_s2)}
            xUnit="s"
            yUnit="m/s²"
            height={130}
          />
        </>
      )}
      {steps.length > 0 && (
        <LinePlot
          label="Time from scan to scan, as received"
          x={timeline.scan_t_s.slice(1)}
          lines={[{ label: "scan", color: "var(--accent)", values: steps }]}
          xUnit="s"
          yUnit="ms"
          height={110}
        />
      )}
    </section>
  );
}
