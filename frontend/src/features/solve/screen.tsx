import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect } from "react";
import { useNavigate, useSearchParams } from "react-router";
import type { IterationEvent, Job, PlaneLook, SolveOutcome } from "../../api/client";
import { isFinal, useJobStream, type RunLog } from "../../api/jobstream";
import { useChangeView, useRetryJob, useStartJob } from "../../api/changes";
import { resultQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { LinePlot } from "../../ui/lineplot";
import { Fault, Notice } from "../../ui/notice";
import { Panel, Section } from "../../ui/panel";
import { useShortcuts } from "../../ui/shortcuts";
import { NextSteps } from "../result/nextsteps";
import { useWorkspace } from "../workspace/context";
import { ParameterTable, ResidualBars } from "./funnel";
import { SolveOptions } from "./options";
import { anglesOf, answerOf, costs, parametersOf } from "./parameters";
import { JobProgress } from "../jobs/progress";
import css from "./solve.module.css";
import { useStraightening } from "./straightening";
import { saidBelow, stagesOfSolve, standingOf } from "../jobs/timeleft";

const optionsForm = "solve-options";

/** The solve as it runs: how far, how sure, and the cloud straightening beside it. */
export function SolveScreen() {
  const { recording, runs, returns } = useWorkspace();
  const [query, setQuery] = useSearchParams();
  const navigate = useNavigate();
  const { mutate: changeView } = useChangeView(recording.id);
  const start = useStartJob(recording.id);
  const retry = useRetryJob();

  const latest = recording.latest_job?.kind === "solve" ? recording.latest_job.id : (runs[0]?.job.id ?? null);
  const jobId = query.get("job") ?? latest;
  const run = useJobStream(jobId);
  // For a moment after another run is chosen the stream still has the one before.
  const job = run.job?.id === jobId ? run.job : null;
  const ended = job !== null && isFinal(job);
  const outcome = job?.result?.kind === "solve" ? job.result : null;
  const hasEstimate = run.iterations.length > 0;

  useEffect(() => {
    changeView({ mode: "solve", job_id: jobId, nudge: null, straight: 1 });
  }, [changeView, jobId, hasEstimate, ended, returns]);

  const answered = job === null ? null : job.state === "done" && outcome?.status !== "refused";
  useStraightening(jobId, answered, changeView);
  const follow = (made: Job) => setQuery({ job: made.id });
  const refused = outcome?.status === "refused";
  // What helps is what the result's own page offers.
  const shown = runs.find((one) => one.job.id === jobId);
  const told = useQuery({ ...resultQuery(jobId ?? ""), enabled: refused && jobId !== null }).data;
  const onward = outcome === null ? null : outcome.status === "refused" ? "result" : "inspect";
  const goOn = () => onward !== null && jobId !== null && void navigate(`/r/${recording.id}/${onward}?job=${jobId}`);
  useShortcuts("Solve", [
    { keys: "Enter", label: onward === "inspect" ? "Inspect the answer" : "See the result", run: goOn },
  ]);

  if (jobId === null) {
    return (
      <Panel
        title="Nothing has been solved yet"
        lead="The planes you confirmed are used; no start value is needed."
        footer={
          <Button fullWidth type="submit" form={optionsForm} loading={start.isPending}>
            Solve
          </Button>
        }
      >
        <SolveOptions
          recordingId={recording.id}
          title="How to solve"
          action={null}
          formId={optionsForm}
          before={null}
          onSolve={(wish) => start.mutate({ kind: "solve", ...wish }, { onSuccess: follow })}
          pending={start.isPending}
          error={start.error}
        />
      </Panel>
    );
  }

  const looks = new Map((job?.planes ?? []).map((plane) => [plane.name, plane]));
  const notable = run.logs.filter((log) => log.level !== "info");
  return (
    <Panel
      title={standingOf(job)}
      lead={
        job === null || ended
          ? saidBelow(job, outcome?.verdict ?? "")
          : "Close the page if you like: the run goes on without it."
      }
      footer={
        <Button fullWidth disabled={onward === null} onClick={goOn} rightSection={<Icon name="next" />}>
          {onward === "result" ? "See why" : "Inspect the answer"}
        </Button>
      }
    >
      <Section title="Progress">
        <JobProgress run={run} jobId={jobId} expected={stagesOfSolve} />
        {job !== null && ended && job.state !== "done" && (
          <Notice
            level={job.state === "failed" ? "error" : "warning"}
            actions={
              <Button
                size="compact-sm"
                variant="default"
                leftSection={<Icon name="restart" size={13} />}
                loading={retry.isPending}
                onClick={() => retry.mutate(jobId, { onSuccess: follow })}
              >
                Once more as it was
              </Button>
            }
          >
            {job.error?.text ?? job.state_text}
          </Notice>
        )}
        {retry.isError && <Fault error={retry.error} />}
      </Section>
      {refused
        ? told !== undefined && shown !== undefined && <NextSteps recording={recording} run={shown} result={told} />
        : (!ended || hasEstimate) && <Estimate run={run} looks={looks} answer={outcome} />}
      {notable.length > 0 && (
        <Section title="Said on the way">
          <div className={css.logs}>
            {notable.map((log, i) => (
              <Notice key={i} level={log.level}>
                {log.text}
              </Notice>
            ))}
          </div>
        </Section>
      )}
      {ended && (
        <SolveOptions
          recordingId={recording.id}
          key={job.id}
          title="Solve again, differently"
          action="Solve again"
          formId={optionsForm}
          before={job.settings}
          onSolve={(wish) => start.mutate({ kind: "solve", ...wish }, { onSuccess: follow })}
          pending={start.isPending}
          error={start.error}
        />
      )}
    </Panel>
  );
}

interface EstimateProps {
  run: RunLog;
  looks: ReadonlyMap<string, PlaneLook>;
  /** What it came to, once it has ended: the numbers of the verdict, the report and the files. */
  answer: SolveOutcome | null;
}

/** The numbers of the last iteration, and how the run came to them. */
function Estimate({ run, looks, answer }: EstimateProps) {
  const last = run.iterations.at(-1);
  const answers = [...run.iterations, ...answerOf(answer, run.job?.settings.estimate_time_offset === false)];
  return (
    <>
      <Section title={answer !== null ? "Answer" : "Answer so far"}>
        <ParameterTable parameters={parametersOf(answers)} angles={anglesOf(answers)} />
      </Section>
      <Section title="Cost">
        <CostPlot iterations={run.iterations} />
        <p className="dim small">Each round takes in more points, so the cost may step up between rounds.</p>
      </Section>
      <Section title="Distance of points to their plane" tools={<span className="dim small">rms, mm</span>}>
        {last === undefined ? (
          <p className="dim small">Shown once the joint solve begins.</p>
        ) : (
          <>
            <ResidualBars rows={last.planes} looks={looks} />
            <p className="dim small">
              Surer distances count more, so it is less than the plain spread on Planes and the thickness on Inspect.
            </p>
          </>
        )}
      </Section>
    </>
  );
}

function CostPlot({ iterations }: { iterations: readonly IterationEvent[] }) {
  return (
    <LinePlot
      label="Weighted squared residuals"
      x={iterations.map((_, i) => i + 1)}
      lines={[{ label: "cost", color: "var(--accent)", values: costs(iterations) }]}
      xUnit="iteration"
      yUnit=""
      height={110}
      logarithmic
    />
  );
}
