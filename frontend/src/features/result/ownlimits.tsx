import { Button, TextInput } from "@mantine/core";
import { useState } from "react";
import type { CalibrationResult } from "../../api/client";
import { beyond, useOwnLimits, type OwnLimits } from "../../api/ownlimits";
import { useUsualLimits } from "../../api/queries";
import { numberOf } from "../../ui/format";
import { LevelIcon } from "../../ui/icons";
import { Section } from "../../ui/panel";
import css from "./result.module.css";

/** How well it has to be known for one's own use; the bars and a sentence go by it, on every recording. */
export function OwnLimitsSection() {
  const { own, setOwn } = useOwnLimits();
  const usual = useUsualLimits();
  const [draft, setDraft] = useState<Record<keyof OwnLimits, string>>({
    deg: own === null ? "" : String(own.deg),
    mm: own === null ? "" : String(own.mm),
    ms: own === null ? "" : String(own.ms),
  });
  const usualText = {
    deg: usual.rotation_deg,
    mm: usual.translation_m * 1000,
    ms: usual.time_offset_s * 1000,
  };
  const field = (name: keyof OwnLimits, label: string) => (
    <TextInput
      size="xs"
      inputMode="decimal"
      label={label}
      placeholder={String(Number(usualText[name].toPrecision(3)))}
      value={draft[name]}
      error={draft[name].trim() !== "" && limitOf(draft[name], 1) === null}
      onChange={(event) => {
        // The updater may run when the event has none any more.
        const { value } = event.currentTarget;
        setDraft((old) => ({ ...old, [name]: value }));
      }}
    />
  );
  const [deg, mm, ms] = [
    limitOf(draft.deg, usualText.deg),
    limitOf(draft.mm, usualText.mm),
    limitOf(draft.ms, usualText.ms),
  ];
  const wanted = deg === null || mm === null || ms === null ? null : { deg, mm, ms };
  return (
    <Section
      title="Enough for your use"
      tools={
        own !== null && (
          <Button
            size="compact-xs"
            variant="default"
            onClick={() => {
              setOwn(null);
              setDraft({ deg: "", mm: "", ms: "" });
            }}
          >
            The usual limits
          </Button>
        )
      }
    >
      <form
        className={css.ownLimits}
        onSubmit={(event) => {
          event.preventDefault();
          if (wanted !== null) setOwn(wanted);
        }}
      >
        {field("deg", "Turn, °")}
        {field("mm", "Position, mm")}
        {field("ms", "Time, ms")}
        <Button type="submit" size="xs" variant="default" disabled={wanted === null}>
          Use
        </Button>
      </form>
      <p className="dim small">One standard deviation of every axis. Kept in this browser, for all recordings.</p>
    </Section>
  );
}

/** The number that is meant, the usual one for an empty field; null for what is none. */
function limitOf(text: string, usual: number): number | null {
  if (text.trim() === "") return usual;
  const value = numberOf(text);
  return value !== null && value > 0 ? value : null;
}

/** What one's own limits say of an answer; nothing where there are none, or no answer. */
export function OwnVerdict({ result }: { result: CalibrationResult }) {
  const { own } = useOwnLimits();
  const faults = own === null ? null : beyond(result, own);
  if (own === null || faults === null) return null;
  const limits = `${own.mm} mm, ${own.deg}° and ${own.ms} ms`;
  return (
    <p className={css.ownVerdict} role="status" aria-label="By your own limits">
      <LevelIcon level={faults.length === 0 ? "good" : "warning"} size={17} />
      {faults.length === 0
        ? `Enough for your use: within ${limits} on every axis.`
        : `Not enough for your use (${limits}): ${faults.join(", ")}.`}
    </p>
  );
}
