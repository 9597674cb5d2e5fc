import { Link } from "react-router";
import type { Run } from "../../api/client";
import { useNow } from "../../ui/clock";
import { ago, fixed } from "../../ui/format";
import { LevelIcon, type Tone } from "../../ui/icons";
import css from "./result.module.css";

/** All runs, newest first, and how far the newest answer is from each. */
export function History({ runs, shown }: { runs: readonly Run[]; shown: string }) {
  const now = useNow(30_000);
  return (
    <ol className={css.history}>
      {runs.map((run) => (
        <li key={run.job.id}>
          <Link to={`?job=${run.job.id}`} aria-current={run.job.id === shown ? "true" : undefined}>
            <LevelIcon level={toneOf(run)} size={15} />
            <span className={css.runText}>
              <span className="clip">
                {run.job.settings.method === "paper" ? "As published" : "Full"}
                {choices(run)}
              </span>
              <span className="dim">{difference(run)}</span>
            </span>
            <span className="dim nowrap">{ago(Date.parse(run.job.created_at), now)}</span>
          </Link>
        </li>
      ))}
    </ol>
  );
}

function toneOf(run: Run): Tone {
  if (run.job.result?.kind !== "solve") return run.job.state === "failed" ? "error" : "info";
  switch (run.job.result.status) {
    case "calibrated":
      return "good";
    case "weak":
      return "warning";
    case "refused":
      return "error";
  }
}

function choices(run: Run): string {
  const { points_per_plane_per_scan: points, field_of_view_deg: field, estimate_time_offset: offset } = run.job.settings;
  return [
    points === null || points === undefined ? "" : `, ${points} points`,
    field === null || field === undefined ? "" : `, ±${field}°`,
    offset ? "" : ", clock held",
  ].join("");
}

function difference(run: Run): string {
  const from = run.from_latest;
  if (run.job.state !== "done") return run.job.state_text;
  if (from === null || from === undefined) return "";
  return `newest differs by ${fixed(from.translation_m * 1000, 1)} mm, ${fixed(from.rotation_deg, 3)}°, ${fixed(from.time_offset_s * 1000, 2)} ms`;
}
