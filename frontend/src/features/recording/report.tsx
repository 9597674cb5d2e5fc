import { Button } from "@mantine/core";
import type { ReactNode } from "react";
import type { DoctorReport, FindingReport, Planes, Recording } from "../../api/client";
import { useChangeRecording } from "../../api/changes";
import { fixed } from "../../ui/format";
import { LevelIcon, type Tone } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import { sentenceCase } from "../../ui/words";
import { GuideButton } from "../guide/dialog";
import { Evidence } from "./evidence";
import { Forecast, planesText } from "./forecast";
import { fixOf, fixText, isOffered } from "./fixes";
import css from "./recording.module.css";
import { openChoices } from "./sensors";
import { SpanStrip } from "./strip";

const tones: Record<DoctorReport["verdict"], Tone> = { good: "good", limited: "warning", unusable: "error" };
const headings: Record<DoctorReport["verdict"], string> = {
  good: "Good to calibrate",
  limited: "Usable, with limits",
  unusable: "Not usable as it is",
};

interface ReportProps {
  recording: Recording;
  report: DoctorReport;
  /** Undefined until they have been found. */
  planes: Planes | undefined;
  /** What is shown instead of a verdict until there is one. */
  children: ReactNode;
}

/** The doctor's report: a verdict, the span to use, what was found and how to put it right; what is known of it so far. */
export function Report({ recording, report, planes, children }: ReportProps) {
  const change = useChangeRecording(recording.id);
  const { start_s: startS, end_s: endS } = recording.read_settings;
  const advice = [...new Set([...report.advice, ...(report.forecast?.advice ?? [])])];
  const fix = (override: string) => {
    const wanted = fixOf(override);
    if (wanted !== null) change.mutate(wanted);
  };
  const findings = settledFindings(report);
  const problems = findings.filter((finding) => finding.level !== "info");
  const recognised = findings.filter((finding) => finding.level === "info");
  return (
    <div className={css.report}>
      {report.final ? <Verdict recording={recording} report={report} change={change} /> : children}
      {report.timeline.t_s.length > 1 && (
        <SpanStrip
          key={`${startS ?? "start"}-${endS ?? "end"}`}
          timeline={report.timeline}
          still={report.imu?.still_spans ?? []}
          durationS={report.duration_s}
          startS={startS ?? null}
          endS={endS ?? null}
          pending={change.isPending}
          onUse={(span) => change.mutate(span)}
        />
      )}
      {change.isError && <Fault error={change.error} />}
      <Findings
        title="What to look at"
        findings={problems}
        read={recording.read_settings}
        pending={change.isPending}
        onFix={fix}
      />
      {report.forecast !== null && report.forecast !== undefined && (
        <Forecast forecast={report.forecast} planes={planesText(report.planes, planes)} said={report.reasons} />
      )}
      {report.final && advice.length > 0 && (
        <section aria-label="Advice">
          <h2 className={css.heading}>For a better recording</h2>
          <ul className={css.bullets}>
            {advice.map((sentence) => (
              <li key={sentence}>{sentence}</li>
            ))}
          </ul>
          <GuideButton />
        </section>
      )}
      {(report.final || report.timeline.t_s.length > 1) && <Evidence timeline={report.timeline} />}
      <Findings
        title="What was recognised"
        findings={recognised}
        read={recording.read_settings}
        pending={change.isPending}
        onFix={fix}
      />
    </div>
  );
}

/** Those that nothing is still to come about: what unit the gyroscope reads in is told by the lidar's turning, so that until a lidar
 *  is chosen it is a guess that nobody has to settle. */
export function settledFindings({
  findings,
  lidar,
  lidar_candidates,
}: Pick<DoctorReport, "findings" | "lidar" | "lidar_candidates">): FindingReport[] {
  const chosen = lidar !== null || lidar_candidates.length < 2;
  return findings.filter(({ code, confidence }) => chosen || code !== "imu.gyroscope_unit" || confidence >= 0.95);
}

interface VerdictProps {
  recording: Recording;
  report: DoctorReport;
  change: ReturnType<typeof useChangeRecording>;
}

/** The doctor's word and its reasons. */
function Verdict({ recording, report, change }: VerdictProps) {
  return (
    <header className={css.verdict}>
      <LevelIcon level={tones[report.verdict]} size={26} />
      <div>
        <h1>{headings[report.verdict]}</h1>
        {report.reasons.map((reason) => (
          <p key={reason}>{reason}</p>
        ))}
        <Choices report={report} change={change} />
        {lacksPointTimes(recording, report) && (
          <div className={css.cure}>
            <Button
              size="compact-md"
              loading={change.isPending}
              onClick={() => change.mutate({ synthesise_point_time: true })}
            >
              Make up point times
            </Button>
            <p className="dim small">
              From the order in which a sweep goes round: it costs accuracy, and says so. A recording with its own times
              is better.
            </p>
            <Button
              size="compact-md"
              variant="default"
              loading={change.isPending}
              onClick={() => change.mutate({ points_at_once: true })}
            >
              All points at once
            </Button>
            <p className="dim small">
              Of a flash lidar or a depth camera, which takes all points of a cloud at its stamp.
            </p>
          </div>
        )}
      </div>
    </header>
  );
}

/** Where several sensors fit, each of them: without one nothing is told of the recording. */
function Choices({ report, change }: Pick<VerdictProps, "report" | "change">) {
  const choices = openChoices(report);
  if (choices.length === 0) return null;
  return (
    <div className={css.choices}>
      {choices.map(({ name, topic, change: chosen }) => (
        <Button
          key={name + topic}
          size="compact-md"
          variant="default"
          loading={change.isPending}
          onClick={() => change.mutate(chosen)}
        >
          {`Use the ${name} ${topic}`}
        </Button>
      ))}
    </div>
  );
}

/** Without a time for each point there is nothing to calibrate; the one cure that this recording has. */
export function lacksPointTimes(recording: Pick<Recording, "read_settings">, report: DoctorReport): boolean {
  const made = recording.read_settings.synthesise_point_time || recording.read_settings.points_at_once;
  return report.lidar !== null && report.lidar.point_time === null && !made;
}

const order: Record<FindingReport["level"], number> = { error: 0, warning: 1, info: 2 };

interface FindingsProps {
  title: string;
  findings: readonly FindingReport[];
  read: Recording["read_settings"];
  pending: boolean;
  onFix: (override: string) => void;
}

function Findings({ title, findings, read, pending, onFix }: FindingsProps) {
  if (findings.length === 0) return null;
  const sorted = [...findings].sort((a, b) => order[a.level] - order[b.level]);
  return (
    <section aria-label={title}>
      <h2 className={css.heading}>{title}</h2>
      <ul className={css.cards}>
        {sorted.map((finding) => (
          <FindingCard
            key={finding.code + finding.text}
            finding={finding}
            read={read}
            pending={pending}
            onFix={onFix}
          />
        ))}
      </ul>
    </section>
  );
}

function FindingCard({
  finding,
  read,
  pending,
  onFix,
}: {
  finding: FindingReport;
  read: Recording["read_settings"];
  pending: boolean;
  onFix: (override: string) => void;
}) {
  const { override } = finding;
  return (
    <li className={css.card} data-level={finding.level}>
      <LevelIcon level={finding.level === "info" ? "info" : finding.level} />
      <div>
        <p>{finding.text}</p>
        {finding.consequence !== "" && <p className={css.consequence}>{sentenceCase(finding.consequence)}</p>}
        {finding.evidence.length > 0 && (
          <dl className={css.evidence}>
            {finding.evidence.map((item) => (
              <div key={item.name}>
                <dt>{item.name.replaceAll("_", " ")}</dt>
                <dd className="num">
                  {typeof item.value === "number" ? short(item.value) : item.value} {item.unit.replace(/\/s2\b/, "/s²")}
                </dd>
              </div>
            ))}
          </dl>
        )}
        {isOffered(finding, read) && (
          <Button
            className={css.fix ?? ""}
            size="compact-xs"
            variant="default"
            disabled={pending}
            onClick={() => onFix(override)}
          >
            {fixText(override)}
          </Button>
        )}
      </div>
      {finding.confidence < 0.995 && (
        <span className={`num ${css.confidence ?? ""}`} title="How sure this is">
          {fixed(finding.confidence * 100, 0)} % sure
        </span>
      )}
    </li>
  );
}

function short(value: number): string {
  return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(4)));
}
