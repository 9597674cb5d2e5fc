import { Button, Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link, useSearchParams } from "react-router";
import type { Job } from "../../api/client";
import { sparse } from "../../api/client";
import { isFinal, useJobStream } from "../../api/jobstream";
import { useRetryJob, useStartAudit } from "../../api/changes";
import { auditQuery, useUsualLimits } from "../../api/queries";
import { useNow } from "../../ui/clock";
import { ago } from "../../ui/format";
import { LevelIcon } from "../../ui/icons";
import { Fault, Notice, StateBox } from "../../ui/notice";
import { Panel, Section } from "../../ui/panel";
import { JobProgress } from "../jobs/progress";
import { stagesOfSolve } from "../jobs/timeleft";
import { useWorkspace } from "../workspace/context";
import layout from "../workspace/layout.module.css";
import css from "./audit.module.css";
import { AuditForm, type AuditDraft } from "./form";
import { limitsOf, limitsText, rememberedLimits, rememberLimits, type LimitsText } from "./limits";
import { AuditDocument } from "./report";
import { verdictTones, verdictWords } from "./words";

/** Is the extrinsic in use still right? Asked of a recording before any solve. */
export function AuditScreen() {
  const { recording, jobs } = useWorkspace();
  const [query, setQuery] = useSearchParams();
  const usual = limitsText(useUsualLimits());
  const [chosen, setChosen] = useState<Omit<AuditDraft, "limits"> & { limits: LimitsText | null }>({
    text: "",
    file: "",
    direction: "imu_lidar",
    limits: null,
  });
  const draft: AuditDraft = { ...chosen, limits: chosen.limits ?? rememberedLimits(usual) };
  const start = useStartAudit(recording.id);
  const audits = jobs?.filter((job) => job.kind === "audit") ?? [];
  const shown = query.get("job") ?? audits[0]?.id ?? null;
  const limits = limitsOf(draft.limits);
  const begin = () => {
    if (limits === null) return;
    rememberLimits(draft.limits);
    start.mutate(
      { extrinsic: draft.text, direction: draft.direction, limits: sparse(limits) },
      { onSuccess: (job) => setQuery({ job: job.id }) },
    );
  };
  return (
    <>
      <div className={layout.main}>
        <div className={layout.pad}>
          {shown === null ? <Nothing /> : <Audit key={shown} jobId={shown} recordingId={recording.id} />}
        </div>
      </div>
      <Panel
        title="Audit"
        lead="Is the extrinsic in use still right, and would an error have shown?"
        footer={
          <Button
            fullWidth
            disabled={draft.text.trim() === "" || limits === null}
            loading={start.isPending}
            onClick={begin}
          >
            Audit it
          </Button>
        }
      >
        <AuditForm
          draft={draft}
          onChange={(part) => setChosen((old) => ({ ...old, ...part }))}
          limitsFit={limits !== null}
        />
        {start.isError && <Fault error={start.error} />}
        {audits.length > 0 && (
          <Section title="Audits of this recording">
            <Earlier audits={audits} shown={shown} />
          </Section>
        )}
        <p className={css.back}>
          <Link to={`/r/${recording.id}/recording`}>Back to the recording</Link>
        </p>
      </Panel>
    </>
  );
}

function Nothing() {
  return (
    <StateBox title="Hold an extrinsic against this recording">
      <p>
        The recording is calibrated by itself, and what you use now is compared with it, axis by axis. No planes have to
        be chosen first.
      </p>
    </StateBox>
  );
}

function Audit({ jobId, recordingId }: { jobId: string; recordingId: string }) {
  const run = useJobStream(jobId);
  const retry = useRetryJob();
  const [, setQuery] = useSearchParams();
  const done = run.job?.state === "done";
  const report = useQuery({ ...auditQuery(jobId), enabled: done });
  if (report.data !== undefined) return <AuditDocument report={report.data} jobId={jobId} recordingId={recordingId} />;
  if (report.isError) return <Fault error={report.error} onRetry={() => void report.refetch()} />;
  if (run.job !== null && isFinal(run.job) && !done) {
    return (
      <Notice
        level="error"
        actions={
          <Button
            size="compact-sm"
            variant="default"
            loading={retry.isPending}
            onClick={() => retry.mutate(jobId, { onSuccess: (job) => setQuery({ job: job.id }) })}
          >
            Try again
          </Button>
        }
      >
        {run.job.error?.text ?? run.job.state_text}
      </Notice>
    );
  }
  if (done) return <Skeleton height={280} />;
  return (
    <section className={css.running} aria-label="The audit as it runs">
      <h1>Auditing</h1>
      <JobProgress run={run} jobId={jobId} expected={stagesOfSolve} />
    </section>
  );
}

function Earlier({ audits, shown }: { audits: readonly Job[]; shown: string | null }) {
  const now = useNow(30_000);
  return (
    <ol className={css.earlier}>
      {audits.map((job) => {
        const verdict = job.result?.kind === "audit" ? job.result.verdict : null;
        return (
          <li key={job.id}>
            <Link to={`?job=${job.id}`} aria-current={job.id === shown ? "true" : undefined}>
              <LevelIcon level={verdict === null ? "info" : verdictTones[verdict]} size={15} />
              <span>{verdict === null ? job.state_text : verdictWords[verdict]}</span>
              <span className="dim nowrap">{ago(Date.parse(job.created_at), now)}</span>
            </Link>
          </li>
        );
      })}
    </ol>
  );
}
