import { Button, NativeSelect, SegmentedControl, Switch, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useRef, useState } from "react";
import { useSearchParams } from "react-router";
import type { Job, NewJob, OldExtrinsic, ServerFacts } from "../../api/client";
import { sparse } from "../../api/client";
import { factsQuery } from "../../api/queries";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import { asking, chosenBlocks, draftOf, givenDensities, priorField, problemsOf, settingsOf, type Draft } from "./draft";
import { Priors } from "./known";
import { guessOf, StartValue } from "./startvalue";
import css from "./solve.module.css";

type NumberPart = "gravityNumber" | "points" | "fieldDeg" | "rounds" | "seed";
type Choice = "gravity" | "imuNoise" | "lidar" | "biasModel" | "imuSampling" | "lidarSampling" | "intrinsics";

interface SolveOptionsProps {
  recordingId: string;
  title: string;
  /** What is written on the button; null where the form of this id has its button elsewhere. */
  action: string | null;
  formId: string;
  /** Of the run that is shown, whose choices stay chosen; nothing before the first. */
  before: Job["settings"] | null;
  onSolve: (wish: Pick<NewJob, "settings"> & Partial<Pick<NewJob, "initial_guess">>) => void;
  pending: boolean;
  error: unknown;
}

/** Everything that a solve can be told, as controls; all of it is found from the recording where it is left alone. */
export function SolveOptions(props: SolveOptionsProps) {
  const facts = useQuery(factsQuery).data;
  return facts === undefined ? null : (
    <Controls {...props} facts={facts} before={props.before ?? facts.solve_settings} />
  );
}

interface ControlsProps extends SolveOptionsProps {
  facts: ServerFacts;
  before: Job["settings"];
}

function Controls({ recordingId, facts, title, action, formId, before, onSolve, pending, error }: ControlsProps) {
  const { usual, imu_presets: presets } = facts;
  const sought = useSearchParams()[0].get("known");
  const [draft, setDraft] = useState<Draft>(() => asking(draftOf(before, usual, facts.solve_settings), sought));
  const [guess, setGuess] = useState<OldExtrinsic | null>(null);
  // What no control has another name for can be chosen as it was.
  const kept = draftOf(before, usual, facts.solve_settings);
  const set = (part: Partial<Draft>) => setDraft((old) => ({ ...old, ...part }));
  const paper = draft.method === "paper";
  const settings = settingsOf(draft, before, usual);
  const problem = problemsOf(draft, usual, facts.axis_names).at(0);
  // What is only unfinished is no fault before somebody wants to go on.
  const [wanted, setWanted] = useState(false);
  const wrong = (field: string) => wanted && problem?.field === field;
  const form = useRef<HTMLFormElement>(null);
  const go = (field: string) => {
    const input = form.current?.elements.namedItem(field);
    if (!(input instanceof HTMLElement)) return;
    const folded = input.closest("details");
    if (folded !== null) folded.open = true;
    input.scrollIntoView({ block: "center" });
    input.focus({ preventScroll: true });
  };
  const spans = before.excluded_spans_s.length;
  const choice = (name: Choice, label: string, data: { value: string; label: string }[]) => (
    <NativeSelect
      size="xs"
      label={label}
      name={name}
      value={draft[name]}
      data={data}
      onChange={(event) => set({ [name]: event.currentTarget.value })}
    />
  );
  const number = (part: NumberPart, field: string, label: string, placeholder: string) => (
    <TextInput
      size="xs"
      inputMode={part === "gravityNumber" || part === "fieldDeg" ? "decimal" : "numeric"}
      name={field}
      error={wrong(field)}
      label={label}
      placeholder={placeholder}
      value={draft[part]}
      onChange={(event) => set({ [part]: event.currentTarget.value })}
    />
  );
  const solve = () => {
    setWanted(true);
    if (problem !== undefined) go(problem.field);
    else if (settings !== null)
      onSolve({ settings: sparse(settings), ...(guess === null ? {} : { initial_guess: guessOf(guess) }) });
  };
  const place = draft.priors.findIndex(({ axis }) => axis === sought);
  useEffect(() => {
    if (place >= 0) go(priorField(place, "value"));
    else if (sought !== null) go(sought);
    // Once, for who was sent here to put it right.
    // eslint-disable-next-line react-hooks/exhaustive-deps
  }, []);
  return (
    <Section title={title}>
      <form
        ref={form}
        id={formId}
        className={css.options}
        onSubmit={(event) => {
          event.preventDefault();
          solve();
        }}
      >
        <div className={css.option}>
          <span id="method-label">Method</span>
          <SegmentedControl
            size="xs"
            aria-labelledby="method-label"
            value={draft.method}
            onChange={(value) => set({ method: value === "paper" ? "paper" : "full" })}
            data={[
              { value: "full", label: "Full" },
              { value: "paper", label: "As published" },
            ]}
          />
        </div>
        <Switch
          size="xs"
          label="Estimate the time offset"
          checked={draft.timeOffset}
          onChange={(event) => set({ timeOffset: event.currentTarget.checked })}
        />
        <h3 className={css.group}>What is known</h3>
        <Priors priors={draft.priors} wrong={wrong} onChange={(priors) => set({ priors })} />
        <details className={css.more}>
          <summary>Sensors, gravity and where to start</summary>
          <div className={css.grid}>
            {choice("gravity", "Gravity", [
              { value: "free", label: gravityText(facts.solve_settings.gravity) },
              { value: "latitude", label: "by latitude" },
              { value: "exact", label: "known exactly" },
              ...(kept.gravity === "before" ? [{ value: "before", label: gravityText(before.gravity) }] : []),
            ])}
            {draft.gravity === "latitude" && number("gravityNumber", "gravity", "Latitude, °", "48.1")}
            {draft.gravity === "exact" && number("gravityNumber", "gravity", "Gravity, m/s²", "9.807")}
            {choice("imuNoise", "IMU noise", [
              { value: "", label: "as measured" },
              ...presets.map((name) => ({ value: name, label: name })),
              ...(kept.imuNoise === givenDensities ? [{ value: givenDensities, label: givenDensities }] : []),
            ])}
            {choice("lidar", "Lidar", [
              { value: "", label: "as recognised" },
              ...facts.lidar_presets.map((name) => ({ value: name, label: name })),
            ])}
            {choice("biasModel", "Biases", [
              { value: "random-walk", label: "drift slowly" },
              { value: "constant", label: "constant" },
            ])}
            {choice("imuSampling", "IMU sampling", [
              { value: "detect", label: "as found" },
              { value: "as-stamped", label: "as stamped" },
              { value: "even", label: "evenly" },
            ])}
            {choice("lidarSampling", "Lidar sampling", [
              { value: "detect", label: "as found" },
              { value: "as-stamped", label: "as stamped" },
            ])}
            {choice("intrinsics", "Sensors' own errors", [
              { value: "auto", label: "where they show" },
              { value: "consider", label: "in the error bars only" },
              { value: "off", label: "taken as none" },
              ...(Array.isArray(before.intrinsics) ? [{ value: chosenBlocks, label: "those named before" }] : []),
            ])}
            {number(
              "points",
              "points",
              "Points per plane and scan",
              paper ? String(usual.paper_points_per_plane_per_scan) : "all",
            )}
            {number(
              "fieldDeg",
              "field",
              "Field of view, ±°",
              paper ? String(usual.paper_field_of_view_deg) : "all around",
            )}
            {number("rounds", "rounds", "Most rounds", String(usual.max_rounds))}
            {number("seed", "seed", "Seed of the plane search", "0")}
          </div>
          <Switch
            size="xs"
            label="Estimate the planes"
            checked={draft.planes}
            onChange={(event) => set({ planes: event.currentTarget.checked })}
          />
          <StartValue recordingId={recordingId} guess={guess} onChange={setGuess} />
        </details>
        {spans > 0 && (
          <p className="small dim">
            {spans === 1 ? "One span of time stays" : `${spans} spans of time stay`} left out; Inspect changes that.
          </p>
        )}
        {problem !== undefined && wanted && (
          <p className={css.problem} role="alert">
            {problem.text}
          </p>
        )}
        {action !== null && (
          <Button type="submit" variant="default" size="compact-md" loading={pending}>
            {action}
          </Button>
        )}
        {error !== null && <Fault error={error} />}
      </form>
    </Section>
  );
}

function gravityText({ magnitude_m_s2, std_m_s2 }: Job["settings"]["gravity"]): string {
  return `${Number(magnitude_m_s2.toPrecision(7))} ± ${Number(std_m_s2.toPrecision(3))} m/s²`;
}
