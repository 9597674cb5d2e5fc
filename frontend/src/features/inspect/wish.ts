import { useCallback, useEffect, useRef } from "react";
import { useSearchParams } from "react-router";
import type { ChangeView, DoctorReport } from "../../api/client";
import { useChangeView } from "../../api/queries";
import { parseNudge, writeNudge, type Nudge } from "./nudges";

export type Show = ChangeView["show"];
export type ColorBy = ChangeView["color_by"];

export interface InspectWish {
  scan: number;
  show: Show;
  colorBy: ColorBy;
  nudge: Nudge;
}

const shows: readonly Show[] = ["raw", "deskewed", "both", "map"];
const colorings: readonly ColorBy[] = ["plane", "time", "residual", "intensity"];

/** What to show, as the URL says it: a reload or a shared link shows the same. */
export function readWish(query: URLSearchParams, firstScan: number): InspectWish {
  const scan = Number(query.get("scan") ?? firstScan);
  return {
    scan: Number.isInteger(scan) && scan >= 0 ? scan : 0,
    show: shows.find((show) => show === query.get("show")) ?? "both",
    colorBy: colorings.find((color) => color === query.get("color")) ?? "plane",
    nudge: parseNudge(query.get("nudge") ?? ""),
  };
}

/** The scan during which the rig turned fastest: there the motion shows most. */
export function fastestScan(timeline: DoctorReport["timeline"] | undefined): number {
  if (timeline === undefined) return 0;
  const fastest = timeline.rotation_norm_deg_s.reduce((best, rate, i, rates) => (rate > (rates[best] ?? 0) ? i : best), 0);
  const atS = timeline.t_s[fastest] ?? 0;
  return Math.max(0, timeline.scan_t_s.findLastIndex((t) => t <= atS));
}

/** The wish in the URL, kept in step with what the scene is told; of quick changes only the last is sent. */
export function useInspectView(recordingId: string, jobId: string | null, firstScan: number) {
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
  useEffect(() => {
    if (jobId === null) return;
    const nudge = parseNudge(nudgeText);
    send({
      mode: "inspect",
      job_id: jobId,
      scan: wish.scan,
      show: wish.show,
      color_by: wish.colorBy,
      nudge: nudgeText === "" ? null : nudge,
    });
  }, [send, jobId, wish.scan, wish.show, wish.colorBy, nudgeText]);

  const change = useCallback(
    (part: Partial<InspectWish>) =>
      setQuery(
        (old) => {
          const query = new URLSearchParams(old);
          if (part.scan !== undefined) query.set("scan", String(part.scan));
          if (part.show !== undefined) query.set("show", part.show);
          if (part.colorBy !== undefined) query.set("color", part.colorBy);
          if (part.nudge !== undefined) {
            const text = writeNudge(part.nudge);
            if (text === "") query.delete("nudge");
            else query.set("nudge", text);
          }
          return query;
        },
        { replace: true },
      ),
    [setQuery],
  );
  return { wish, change };
}
