import { Button } from "@mantine/core";
import { Link } from "react-router";
import type { AuditReport } from "../../api/client";
import { auditDownloadUrl } from "../../api/queries";
import { fixed } from "../../ui/format";
import { Icon, LevelIcon, type Tone } from "../../ui/icons";
import { sentenceCase } from "../../ui/words";
import css from "./audit.module.css";
import { AxisTable } from "./axes";
import { verdictTones, verdictWords } from "./words";

/** May the extrinsic in use stay? One word, one sentence, and each axis for who asks. */
export function AuditDocument({ report, jobId, recordingId }: DocumentProps) {
  const tone: Tone = verdictTones[report.verdict];
  const told = report.text.replace(/^(Passed: |Failed |This recording cannot tell: )/, "");
  const hintsTitle = report.verdict === "passed" ? "What else there is to know" : "What may lie behind it";
  return (
    <div className={css.document}>
      <header className={css.verdict} data-tone={tone}>
        <LevelIcon level={tone} size={30} />
        <div>
          <h1>{verdictWords[report.verdict]}</h1>
          <p>{sentenceCase(told)}</p>
        </div>
      </header>
      {report.axes.length > 0 ? (
        <section className={css.card} aria-label="Given against found">
          <p className="dim small">
            It was read as {report.extrinsic_form}. From what this recording says by itself it is{" "}
            {report.rotation_deg !== null && <span className="num">{fixed(report.rotation_deg, 3)}°</span>} and{" "}
            {report.translation_mm !== null && <span className="num">{fixed(report.translation_mm, 1)} mm</span>} away.
          </p>
          <AxisTable axes={report.axes} />
          <p className="dim small">
            “Shows from”: an error as large would have been found here; it is the limit, or three standard deviations
            where those are more. The drawing has the allowed band, the difference and three standard deviations.
          </p>
        </section>
      ) : (
        <NoAnswer recordingId={recordingId} />
      )}
      {report.hints.length > 0 && (
        <section aria-label={hintsTitle}>
          <h2>{hintsTitle}</h2>
          <ul className={css.bullets}>
            {report.hints.map((hint) => (
              <li key={hint}>{hint}</li>
            ))}
          </ul>
        </section>
      )}
      {report.crispness !== null && (
        <section aria-label="The room with each">
          <h2>The room with each</h2>
          <p>{report.crispness.text}</p>
          <p className="dim small">
            Scans laid together by the IMU alone, three seconds at a time, and measured without planes: evidence beside
            the table, from the same recording.
          </p>
        </section>
      )}
      <div className={css.buttons}>
        <Button
          component="a"
          href={auditDownloadUrl(jobId)}
          download={`audit-${jobId.slice(0, 8)}.json`}
          variant="default"
          size="compact-md"
          leftSection={<Icon name="download" size={13} />}
        >
          Audit as JSON
        </Button>
        <Button component={Link} to={`/r/${recordingId}/planes`} variant="default" size="compact-md">
          Calibrate anew from this recording
        </Button>
      </div>
    </div>
  );
}

interface DocumentProps {
  report: AuditReport;
  jobId: string;
  recordingId: string;
}

/** A recording that gives no answer of its own judges no other. */
function NoAnswer({ recordingId }: { recordingId: string }) {
  return (
    <p>
      The extrinsic may be right or wrong: this recording has no answer of its own to hold it against.{" "}
      <Link to={`/r/${recordingId}/recording`}>See what was found of it</Link>, or record again with brisk turns about
      all three axes.
    </p>
  );
}
