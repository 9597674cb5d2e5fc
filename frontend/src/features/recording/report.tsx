import { Button, Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import type { DoctorReport, FindingReport, Recording } from "../../api/client";
import { timelineQuery, useChangeRecording } from "../../api/queries";
import { fixed } from "../../ui/format";
import { LevelIcon, type Tone } from "../../ui/icons";
import { Fault, Notice } from "../../ui/notice";
import { Evidence } from "./evidence";
import { Forecast } from "./forecast";
import { fixOf, fixText } from "./fixes";
import css from "./recording.module.css";
import { SpanStrip } from "./strip";

const tones: Record<DoctorReport["verdict"], Tone> = { good: "good", limited: "warning", unusable: "error" };
const headings: Record<DoctorReport["verdict"], string> = {
  good: "Good to calibrate",
  limited: "Usable, with limits",
  unusable: "Not usable as it is",
};

/** The doctor's report: a verdict, the span to use, what was found and how to put it right. */
export function Report({ recording }: { recording: Recording }) {
  const report = recording.report;
  const timeline = useQuery(timelineQuery(recording.id));
  const change = useChangeRecording(recording.id);
  return (
    <div className={css.report}>
      {report !== null && report !== undefined && (
        <header className={css.verdict}>
          <LevelIcon level={tones[report.verdict]} size={26} />
          <div>
            <h1>{headings[report.verdict]}</h1>
            {report.reasons.map((reason) => (
              <p key={reason}>{reason}</p>
            ))}
          </div>
        </header>
      )}
      {timeline.isPending ? (
        <Skeleton height={128} />
      ) : timeline.isError ? (
        <Fault error={timeline.error} onRetry={() => void timeline.refetch()} />
      ) : (
        <SpanStrip
          timeline={timeline.data}
          startS={recording.read_settings.start_s ?? null}
          endS={recording.read_settings.end_s ?? null}
          pending={change.isPending}
          onUse={(span) => change.mutate(span)}
        />
      )}
      {change.isError && <Fault error={change.error} />}
      {report?.forecast !== null && report?.forecast !== undefined && <Forecast forecast={report.forecast} advice={report.advice} />}
      {(report?.forecast === null || report?.forecast === undefined) && report !== null && report !== undefined && report.advice.length > 0 && (
        <Notice level="info" more={report.advice.slice(1).join(" ")}>
          {report.advice[0]}
        </Notice>
      )}
      {report !== null && report !== undefined && (
        <Findings findings={report.findings} pending={change.isPending} onFix={(override) => {
          const fix = fixOf(override);
          if (fix !== null) change.mutate(fix);
        }} />
      )}
      {timeline.data !== undefined && <Evidence timeline={timeline.data} />}
    </div>
  );
}

const order: Record<FindingReport["level"], number> = { error: 0, warning: 1, info: 2 };

interface FindingsProps {
  findings: readonly FindingReport[];
  pending: boolean;
  onFix: (override: string) => void;
}

function Findings({ findings, pending, onFix }: FindingsProps) {
  const sorted = [...findings].sort((a, b) => order[a.level] - order[b.level]);
  return (
    <section aria-label="Findings">
      <h2 className={css.heading}>What was found</h2>
      <ul className={css.cards}>
        {sorted.map((finding) => (
          <FindingCard key={finding.code + finding.text} finding={finding} pending={pending} onFix={onFix} />
        ))}
      </ul>
    </section>
  );
}

function FindingCard({ finding, pending, onFix }: { finding: FindingReport; pending: boolean; onFix: (override: string) => void }) {
  const override = finding.override ?? "";
  return (
    <li className={css.card} data-level={finding.level}>
      <LevelIcon level={finding.level === "info" ? "info" : finding.level} />
      <div>
        <p>{finding.text}</p>
        {finding.consequence !== "" && <p className={css.consequence}>{finding.consequence}</p>}
        {finding.evidence.length > 0 && (
          <dl className={css.evidence}>
            {finding.evidence.map((item) => (
              <div key={item.name}>
                <dt>{item.name.replaceAll("_", " ")}</dt>
                <dd className="num">
                  {typeof item.value === "number" ? short(item.value) : item.value} {item.unit}
                </dd>
              </div>
            ))}
          </dl>
        )}
        {fixOf(override) !== null && (
          <Button size="compact-xs" variant="default" mt={8} disabled={pending} onClick={() => onFix(override)} title={override}>
            Read it differently: {fixText(override)}
          </Button>
        )}
      </div>
      {finding.confidence < 0.995 && (
        <span className={`num ${css.confidence ?? ""}`} title="How sure this is">
          {fixed(finding.confidence * 100, 0)} %
        </span>
      )}
    </li>
  );
}

function short(value: number): string {
  return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(4)));
}
