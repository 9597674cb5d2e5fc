import { ActionIcon, Button } from "@mantine/core";
import { fixed } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import css from "./inspect.module.css";
import { holdsScan, joined, sameSpans, spanOfScan, without, withoutScan, type TimeSpan } from "./spans";

interface ExcludeSectionProps {
  wished: readonly TimeSpan[];
  /** What this run left out already. */
  done: readonly TimeSpan[];
  scan: number;
  scanTimeS: number | null;
  periodS: number;
  worst: number | null;
  onScan: (scan: number) => void;
  onChange: (spans: TimeSpan[]) => void;
  onSolve: () => void;
  pending: boolean;
  error: unknown;
}

/** Spans of time that the next solve does without. */
export function ExcludeSection({
  wished,
  done,
  scan,
  scanTimeS,
  periodS,
  worst,
  onScan,
  onChange,
  onSolve,
  pending,
  error,
}: ExcludeSectionProps) {
  const changed = !sameSpans(wished, done);
  const isOut = scanTimeS !== null && holdsScan(wished, scanTimeS, periodS);
  const toggle = () => {
    if (scanTimeS === null) return;
    onChange(isOut ? withoutScan(wished, scanTimeS, periodS) : joined(wished, spanOfScan(scanTimeS, periodS)));
  };
  return (
    <Section
      title="Leave out and solve again"
      tools={
        worst !== null && (
          <Button size="compact-xs" variant="default" onClick={() => onScan(worst)}>
            Go to the worst scan
          </Button>
        )
      }
    >
      <p className={css.hint}>Drag across the scans below the scene, or leave out the one that is shown.</p>
      {wished.length > 0 && (
        <ul className={css.spans} aria-label="Spans to leave out">
          {wished.map((span) => (
            <li key={span[0]}>
              <span className="num">
                {fixed(span[0], 2)} to {fixed(span[1], 2)} s
              </span>
              <ActionIcon
                size="sm"
                variant="subtle"
                color="gray"
                aria-label={`Keep ${fixed(span[0], 2)} to ${fixed(span[1], 2)} s`}
                onClick={() => onChange(without(wished, span))}
              >
                <Icon name="cross" size={12} />
              </ActionIcon>
            </li>
          ))}
        </ul>
      )}
      <div className={css.row}>
        <Button
          size="compact-sm"
          variant={isOut ? "light" : "default"}
          aria-pressed={isOut}
          disabled={scanTimeS === null}
          title={isOut ? "Click to use it again" : undefined}
          leftSection={isOut && <Icon name="check" size={12} />}
          onClick={toggle}
        >
          Leave out scan {scan + 1}
        </Button>
        <Button size="compact-sm" disabled={!changed} loading={pending} onClick={onSolve}>
          {wished.length > 0 ? "Solve again without it" : "Solve again with all"}
        </Button>
      </div>
      {error !== null && <Fault error={error} />}
    </Section>
  );
}
