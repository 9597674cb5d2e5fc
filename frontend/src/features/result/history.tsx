import { Link } from "react-router";
import type { Run } from "../../api/client";
import { useNow } from "../../ui/clock";
import { ago, fixed, plusMinusStd, stdText } from "../../ui/format";
import { LevelIcon, type Tone } from "../../ui/icons";
import { planesOf } from "../../ui/words";
import css from "./result.module.css";
import { toneOf as toneOfResult } from "./verdict";

/** As sentences elsewhere name a run: the oldest is the first. */
export function calledRun(run: Run, runs: readonly Run[]): string {
  return `Run ${runs.length - runs.indexOf(run)}`;
}

/** All runs, newest first, and how far the newest answer is from each. */
export function History({ runs, shown }: { runs: readonly Run[]; shown: string }) {
  const now = useNow(30_000);
  const latest = runs.findIndex(
    ({ error, job }) => !error && job.result?.kind === "solve" && job.result.status !== "refused",
  );
  return (
    <ol className={css.history}>
      {runs.map((run, i) => (
        <li key={run.job.id}>
          <Link to={`?job=${run.job.id}`} aria-current={run.job.id === shown ? "true" : undefined}>
            <LevelIcon level={toneOf(run)} size={15} />
            <span className={css.runText}>
              <span>
                {calledRun(run, runs)}: {run.job.settings.method === "paper" ? "as published" : "full"}
                {choices(run)}
              </span>
              <span className="dim num">{known(run)}</span>
              <span className="dim">{difference(run, i === latest)}</span>
            </span>
            <span className="dim nowrap">{ago(Date.parse(run.job.created_at), now)}</span>
          </Link>
        </li>
      ))}
    </ol>
  );
}

function toneOf(run: Run): Tone {
  if (run.error) return "error";
  if (run.job.result?.kind !== "solve") return run.job.state === "failed" ? "error" : "info";
  return toneOfResult(run.job.result.status, run.job.result.codes ?? []);
}

/** What a person chose for this run, in words; nothing where all was as it comes. */
function choices(run: Run): string {
  const settings = run.job.settings;
  const { points_per_plane_per_scan: points, field_of_view_deg: field, excluded_spans_s: spans, priors } = settings;
  const planes = run.job.planes ?? [];
  const boxed = planes.filter((plane) => plane.restricted).length;
  return [
    points === null || points === undefined ? "" : `${points} points`,
    field === null || field === undefined ? "" : `±${field}°`,
    settings.estimate_time_offset ? "" : "clock held",
    settings.estimate_planes ? "" : "planes held",
    settings.bias_model === "constant" ? "constant biases" : "",
    settings.imu_sampling === "even" ? "IMU taken as sampled evenly" : "",
    settings.imu_sampling === "as-stamped" ? "IMU taken as stamped" : "",
    settings.lidar_sampling === "as-stamped" ? "sweeps taken as stamped" : "",
    settings.cloud === "as-sent" ? "points taken as sent" : "",
    settings.lidar == null ? "" : `as a ${settings.lidar}`,
    typeof settings.imu_noise === "string" ? `noise of a ${settings.imu_noise}` : "",
    settings.random_seed === 0 ? "" : `seed ${settings.random_seed}`,
    priors.length === 0 ? "" : `${priors.length} ${priors.length === 1 ? "prior" : "priors"}`,
    ...spans.map((span) => `without ${fixed(Number(span[0]), 1)} to ${fixed(Number(span[1]), 1)} s`),
    planesText(run),
    boxed === 0 ? "" : `${boxed} of them within a box`,
  ]
    .filter((text) => text !== "")
    .map((text) => `, ${text}`)
    .join("");
}

/** On how many planes an answer rests, some of which may have come into view, and how many were chosen; of a run without an answer,
 *  how many were chosen. */
function planesText({ job }: Run): string {
  const chosen = job.planes?.length ?? 0;
  const answer = job.result?.kind === "solve" && job.result.status !== "refused" ? job.result : null;
  // Older runs do not tell how many they used.
  const used = answer?.planes_used ?? chosen;
  const planes = used > 0 ? used : chosen;
  if (planes === 0) return "";
  const told = planesOf(planes);
  return planes === chosen ? told : `${told}, ${chosen} chosen`;
}

export function difference(run: Run, latest: boolean): string {
  const from = run.from_latest;
  if (run.error) return run.error.text;
  if (run.job.state !== "done") return run.job.state_text;
  if (run.job.result?.kind === "solve" && run.job.result.status === "refused") return "refused";
  if (from === null || from === undefined) return latest ? "the newest answer" : "";
  return awayText(from);
}

/** How far the newest answer is: distances, which have no sign. */
export function awayText(from: NonNullable<Run["from_latest"]>): string {
  const [mm, deg, ms] = [from.translation_m * 1000, from.rotation_deg, from.time_offset_s * 1000].map(Math.abs);
  return `the newest is ${fixed(mm ?? 0, 1)} mm, ${fixed(deg ?? 0, 3)}°, ${fixed(ms ?? 0, 2)} ms away`;
}

/** One standard deviation of the least known axis of each kind. */
function known(run: Run): string {
  const result = run.job.result;
  if (result?.kind !== "solve" || result.translation_std_m === null || result.rotation_std_deg === null) return "";
  return `${plusMinusStd(Math.max(...result.translation_std_m), "m")}, ${stdText(Math.max(...result.rotation_std_deg), "deg")}`;
}
