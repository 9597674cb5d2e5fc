import { Button, SegmentedControl, Switch, TextInput } from "@mantine/core";
import { useState } from "react";
import type { NewJob } from "../../api/client";
import { sparse } from "../../api/client";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import css from "./solve.module.css";

type Settings = NewJob["settings"];

interface SolveOptionsProps {
  /** Of the run that is shown; what it left out stays out. */
  before: { excluded_spans_s: readonly (readonly number[])[] };
  onSolve: (settings: Settings) => void;
  pending: boolean;
  error: unknown;
}

/** A positive number, or null for an empty or unfinished one. */
function numberOf(text: string): number | null {
  const value = Number(text);
  return text !== "" && value > 0 ? value : null;
}

/** The few choices that are worth a second run; everything else has an option on the command line. */
export function SolveOptions({ before, onSolve, pending, error }: SolveOptionsProps) {
  const [method, setMethod] = useState<Settings["method"]>("full");
  const [points, setPoints] = useState<number | null>(null);
  const [fieldDeg, setFieldDeg] = useState<number | null>(null);
  const [timeOffset, setTimeOffset] = useState(true);
  const paper = method === "paper";
  const settings = sparse<Settings>({
    method,
    points_per_plane_per_scan: points ?? (paper ? 100 : null),
    field_of_view_deg: fieldDeg ?? (paper ? 45 : null),
    estimate_time_offset: timeOffset,
    excluded_spans_s: before.excluded_spans_s.map((span): [number, number] => [span[0] ?? 0, span[1] ?? 0]),
  });
  const spans = before.excluded_spans_s.length;
  return (
    <Section title="Solve again, differently">
      <div className={css.options}>
        <div className={css.option}>
          <span id="method-label">Method</span>
          <SegmentedControl
            size="xs"
            aria-labelledby="method-label"
            value={method}
            onChange={(value) => setMethod(value === "paper" ? "paper" : "full")}
            data={[
              { value: "full", label: "Full" },
              { value: "paper", label: "As published" },
            ]}
          />
        </div>
        <TextInput
          type="number"
          size="xs"
          label="Points per plane and scan"
          placeholder={paper ? "100" : "all"}
          min={1}
          value={points ?? ""}
          onChange={(event) => setPoints(numberOf(event.currentTarget.value))}
        />
        <TextInput
          type="number"
          size="xs"
          label="Field of view, ± degrees of azimuth"
          placeholder={paper ? "45" : "all around"}
          min={1}
          max={180}
          value={fieldDeg ?? ""}
          onChange={(event) => setFieldDeg(numberOf(event.currentTarget.value))}
        />
        <Switch size="xs" label="Estimate the time offset" checked={timeOffset} onChange={(event) => setTimeOffset(event.currentTarget.checked)} />
        {spans > 0 && (
          <p className="small dim">
            {spans === 1 ? "One span of time stays" : `${spans} spans of time stay`} left out; Inspect changes that.
          </p>
        )}
        <Button variant="default" size="compact-md" loading={pending} onClick={() => onSolve(settings)}>
          Solve again
        </Button>
        {error !== null && <Fault error={error} />}
      </div>
    </Section>
  );
}
