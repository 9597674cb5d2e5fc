import type { Timeline } from "../../api/client";
import { LinePlot } from "../../ui/lineplot";
import css from "./recording.module.css";

/** The readings behind the report. */
export function Evidence({ timeline }: { timeline: Timeline }) {
  return (
    <section className={css.plots} aria-label="Readings">
      <LinePlot
        label="Rate of turn"
        x={timeline.t_s}
        lines={[
          { label: "x", color: "var(--axis-x)", values: timeline.gyro_x_deg_s },
          { label: "y", color: "var(--axis-y)", values: timeline.gyro_y_deg_s },
          { label: "z", color: "var(--axis-z)", values: timeline.gyro_z_deg_s },
        ]}
        xUnit="s"
        yUnit="°/s"
        height={130}
      />
      <LinePlot
        label="Acceleration"
        x={timeline.t_s}
        lines={[
          { label: "x", color: "var(--axis-x)", values: timeline.accel_x_m_s2 },
          { label: "y", color: "var(--axis-y)", values: timeline.accel_y_m_s2 },
          { label: "z", color: "var(--axis-z)", values: timeline.accel_z_m_s2 },
        ]}
        xUnit="s"
        yUnit="m/s²"
        height={130}
      />
      <LinePlot
        label="Time from scan to scan"
        x={timeline.scan_t_s.slice(1)}
        lines={[{ label: "scan", color: "var(--accent)", values: timeline.scan_t_s.slice(1).map((t, i) => (t - (timeline.scan_t_s[i] ?? t)) * 1000) }]}
        xUnit="s"
        yUnit="ms"
        height={110}
      />
      <LinePlot
        label="Valid points"
        x={timeline.scan_t_s}
        lines={[{ label: "points", color: "var(--accent)", values: timeline.scan_points }]}
        xUnit="s"
        yUnit="a scan"
        height={110}
      />
    </section>
  );
}
