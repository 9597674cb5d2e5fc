import { ActionIcon, Slider, Tooltip } from "@mantine/core";
import { useEffect, useRef, useState } from "react";
import { count, fixed } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { useShortcuts } from "../../ui/shortcuts";
import css from "./inspect.module.css";

const playEveryMs = 120;

interface TransportProps {
  scan: number;
  scans: number;
  /** Of the shown scan, after the first. */
  timeS: number | null;
  points: number;
  onScan: (scan: number) => void;
}

/** Slider and play through the scans. */
export function Transport({ scan, scans, timeS, points, onScan }: TransportProps) {
  const [playing, setPlaying] = useState(false);
  const last = Math.max(0, scans - 1);
  const go = (to: number) => onScan(Math.max(0, Math.min(last, to)));
  const now = useRef({ scan, last, onScan });
  useEffect(() => {
    now.current = { scan, last, onScan };
  });
  useEffect(() => {
    if (!playing) return;
    const timer = window.setInterval(() => {
      const { scan: at, last: end, onScan: show } = now.current;
      show(at >= end ? 0 : at + 1);
    }, playEveryMs);
    return () => window.clearInterval(timer);
  }, [playing]);
  useShortcuts("Scans", [
    { keys: "ArrowLeft", label: "Scan before", run: () => go(scan - 1) },
    { keys: "ArrowRight", label: "Scan after", run: () => go(scan + 1) },
    { keys: "shift+ArrowLeft", label: "Ten scans back", run: () => go(scan - 10) },
    { keys: "shift+ArrowRight", label: "Ten scans on", run: () => go(scan + 10) },
    { keys: "Space", label: "Play or pause", run: () => setPlaying(!playing) },
  ]);
  return (
    <div className={css.transport} role="group" aria-label="Scans">
      <Tooltip label="Scan before (←)">
        <ActionIcon variant="subtle" color="gray" aria-label="Scan before" onClick={() => go(scan - 1)}>
          <Icon name="previous" />
        </ActionIcon>
      </Tooltip>
      <Tooltip label={playing ? "Pause (Space)" : "Play (Space)"}>
        <ActionIcon variant="default" aria-label={playing ? "Pause" : "Play"} onClick={() => setPlaying(!playing)}>
          <Icon name={playing ? "pause" : "play"} />
        </ActionIcon>
      </Tooltip>
      <Tooltip label="Scan after (→)">
        <ActionIcon variant="subtle" color="gray" aria-label="Scan after" onClick={() => go(scan + 1)}>
          <Icon name="next" />
        </ActionIcon>
      </Tooltip>
      <Slider
        className={css.slider ?? ""}
        size="sm"
        thumbLabel="Scan"
        label={null}
        min={0}
        max={Math.max(1, last)}
        value={Math.min(scan, last)}
        disabled={scans < 2}
        onChange={go}
      />
      <span className={`num ${css.readout ?? ""}`}>{scans === 0 ? "–" : `${scan + 1} / ${scans}`}</span>
      <span className={`num dim ${css.readout ?? ""}`}>{timeS === null ? "" : `${fixed(timeS, 2)} s`}</span>
      <span className={`num dim ${css.points ?? ""}`}>{points === 0 ? "" : `${count(points)} points shown`}</span>
    </div>
  );
}
