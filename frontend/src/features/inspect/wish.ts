import { useCallback, useEffect, useRef } from "react";
import { useSearchParams } from "react-router";
import type { ChangeView, DoctorReport, OldExtrinsic } from "../../api/client";
import { useChangeView } from "../../api/changes";
import { parseNudge, writeNudge, type Nudge } from "./nudges";
import { parseOld, writeOld } from "./oldtext";
import { parseSpans, writeSpans, type TimeSpan } from "./spans";

export type Show = ChangeView["show"];
export type Against = ChangeView["against"];
export type Extent = ChangeView["extent"];
export type ColorBy = ChangeView["color_by"];

export interface InspectWish {
  scan: number;
  show: Show;
  against: Against;
  extent: Extent;
  /** Where the line of the wipe is, share of the canvas's width. */
  wipe: number;
  colorBy: ColorBy;
  nudge: Nudge;
  old: OldExtrinsic | null;
  /** Spans to leave out of the next solve. */
  leaveOut: TimeSpan[];
}

const shows: readonly Show[] = ["raw", "deskewed", "old", "both", "side", "wipe"];
const extents: Record<string, Extent> = { "0": "scan", "1": "map", surface: "surface" };
const colorings: readonly ColorBy[] = ["plane", "time", "residual", "intensity"];

function share(text: string | null): number {
  const value = Number(text ?? 0.5);
  return Number.isFinite(value) ? Math.max(0, Math.min(1, value)) : 0.5;
}

/** A surface is laid through the de-skewed map alone: who wants anything else beside it goes back to the map. */
function fitting(part: Partial<InspectWish>, query: URLSearchParams): Partial<InspectWish> {
  const laid = part.extent === undefined && query.get("map") === "surface";
  return laid && part.show !== undefined && part.show !== "deskewed" ? { ...part, extent: "map" } : part;
}

/** What to show, as the URL says it: a reload or a shared link shows the same.
 *
 *  Where it says nothing, what the motion does to walls is seen best: in the map, whose walls are as thick as the motion is unknown,
 *  raw and de-skewed side by side, coloured by how far points lie off. Both of one scan in one place are points among points. */
export function readWish(query: URLSearchParams, firstScan: number): InspectWish {
  const scan = Number(query.get("scan") ?? firstScan);
  const old = parseOld(query.get("old") ?? "");
  const extent = extents[query.get("map") ?? ""] ?? "map";
  const show = extent === "surface" ? "deskewed" : (shows.find((one) => one === query.get("show")) ?? "side");
  return {
    scan: Number.isInteger(scan) && scan >= 0 ? scan : 0,
    show: show === "old" && old === null ? "raw" : show,
    against: query.get("against") === "old" && old !== null ? "old" : "raw",
    extent,
    wipe: share(query.get("wipe")),
    colorBy: colorings.find((color) => color === query.get("color")) ?? "residual",
    nudge: parseNudge(query.get("nudge") ?? ""),
    old,
    leaveOut: parseSpans(query.get("out") ?? ""),
  };
}

/** The query after a change of the wish; what is as it would be anyway is left out. */
export function writeWish(old: URLSearchParams, change: Partial<InspectWish>): URLSearchParams {
  const part = fitting(change, old);
  const query = new URLSearchParams(old);
  const put = (key: string, text: string) => {
    if (text === "") query.delete(key);
    else query.set(key, text);
  };
  if (part.scan !== undefined) put("scan", String(part.scan));
  if (part.show !== undefined) put("show", part.show);
  if (part.against !== undefined) put("against", part.against === "old" ? "old" : "");
  if (part.extent !== undefined) put("map", { scan: "0", map: "1", surface: "surface" }[part.extent]);
  if (part.wipe !== undefined) put("wipe", part.wipe.toFixed(3));
  if (part.colorBy !== undefined) put("color", part.colorBy);
  if (part.nudge !== undefined) put("nudge", writeNudge(part.nudge));
  if (part.old !== undefined) put("old", part.old === null ? "" : writeOld(part.old));
  if (part.leaveOut !== undefined) put("out", part.leaveOut.length === 0 ? "none" : writeSpans(part.leaveOut));
  return query;
}

/** The scan during which the rig turned fastest: there the motion shows most. */
export function fastestScan(timeline: DoctorReport["timeline"] | undefined): number {
  if (timeline === undefined) return 0;
  const fastest = timeline.rotation_norm_deg_s.reduce(
    (best, rate, i, rates) => (rate > (rates[best] ?? 0) ? i : best),
    0,
  );
  const atS = timeline.t_s[fastest] ?? 0;
  return Math.max(
    0,
    timeline.scan_t_s.findLastIndex((t) => t <= atS),
  );
}

/** The wish in the URL, kept in step with what the scene is told; of quick changes only the last is sent.
 *
 *  returns: how often the tab was come back to while the scene showed another one's screen: it is told again. */
export function useInspectView(recordingId: string, jobId: string | null, firstScan: number, returns: number) {
  const [query, setQuery] = useSearchParams();
  const wish = readWish(query, firstScan);
  const { mutate } = useChangeView(recordingId);
  const busy = useRef(false);
  const next = useRef<Partial<ChangeView> | null>(null);

  const send = useCallback(
    (change: Partial<ChangeView>) => {
      next.current = change;
      if (busy.current) return;
      const step = () => {
        const now = next.current;
        next.current = null;
        busy.current = now !== null;
        if (now !== null) mutate(now, { onSettled: step });
      };
      step();
    },
    [mutate],
  );

  const nudgeText = writeNudge(wish.nudge);
  const oldText = wish.old === null ? "" : writeOld(wish.old);
  const { scan, show, against, extent, wipe, colorBy } = wish;
  useEffect(() => {
    if (jobId === null) return;
    send({
      mode: "inspect",
      job_id: jobId,
      scan,
      show,
      against,
      extent,
      wipe,
      color_by: colorBy,
      nudge: nudgeText === "" ? null : parseNudge(nudgeText),
      old: parseOld(oldText) as ChangeView["old"],
    });
  }, [send, jobId, scan, show, against, extent, wipe, colorBy, nudgeText, oldText, returns]);

  const change = useCallback(
    (part: Partial<InspectWish>) => setQuery((old) => writeWish(old, part), { replace: true }),
    [setQuery],
  );
  return { wish, change };
}
