import { Button, Skeleton, useComputedColorScheme } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link, useNavigate, useSearchParams } from "react-router";
import type { CalibrationResult, Recording, Run } from "../../api/client";
import { mapPageUrl, reportUrl, resultDownloadUrl, resultQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { Fault, StateBox } from "../../ui/notice";
import { Panel, Section } from "../../ui/panel";
import { useShortcuts } from "../../ui/shortcuts";
import { useWorkspace } from "../workspace/context";
import layout from "../workspace/layout.module.css";
import { chosenRun } from "../workspace/state";
import { Advice, Messages } from "./advice";
import { Compare } from "./compare";
import { CommandSection } from "./command";
import { Exports } from "./exports";
import { History } from "./history";
import { poseOf, type Direction } from "./inverse";
import { OwnLimitsSection, OwnVerdict } from "./ownlimits";
import { PoseCard } from "./pose";
import { PartsSection } from "./parts";
import { Quality } from "./quality";
import { NextSteps } from "./nextsteps";
import { isOfSensors, OwnErrors } from "./sensors";
import { toneOf, Verdict } from "./verdict";
import css from "./result.module.css";

/** The answer, how far to trust it, and everything to take it away with. */
export function ResultScreen() {
  const { recording, runs } = useWorkspace();
  const [query] = useSearchParams();
  const run = chosenRun(runs, query.get("job"));
  if (run === undefined) {
    return (
      <div className={layout.whole}>
        <StateBox title="There is no result yet">
          <Button component={Link} to={`/r/${recording.id}/solve`} variant="default" mt="sm">
            Go to the solve
          </Button>
        </StateBox>
      </div>
    );
  }
  return <RunResult key={run.job.id} recording={recording} run={run} runs={runs} />;
}

function RunResult({ recording, run, runs }: { recording: Recording; run: Run; runs: readonly Run[] }) {
  const result = useQuery(resultQuery(run.job.id));
  const navigate = useNavigate();
  const download = () => window.location.assign(resultDownloadUrl(run.job.id));
  const base = `/r/${run.job.recording_id}`;
  const dark = useComputedColorScheme("dark") === "dark";
  const answered = result.data !== undefined && result.data.T_imu_lidar !== null;
  useShortcuts("Result", [
    { keys: "d", label: "Download the JSON", run: download },
    { keys: "i", label: "Back to inspect", run: () => void navigate(`${base}/inspect?job=${run.job.id}`) },
  ]);
  return (
    <>
      <div className={layout.main}>
        <div className={layout.pad}>
          {result.isPending ? (
            <div role="status" aria-busy="true" aria-label="Loading the result">
              <Skeleton height={64} mb={20} />
              <Skeleton height={240} mb={20} />
              <Skeleton height={120} />
            </div>
          ) : result.isError ? (
            <Fault error={result.error} onRetry={() => void result.refetch()} />
          ) : (
            <Document recording={recording} run={run} result={result.data} />
          )}
        </div>
      </div>
      <Panel
        title="Downloads"
        footer={
          <Button
            fullWidth
            component="a"
            href={resultDownloadUrl(run.job.id)}
            download
            leftSection={<Icon name="download" />}
          >
            Download JSON
          </Button>
        }
      >
        <Exports jobId={run.job.id} answered={answered} />
        <Section title="To show to others">
          <div className={css.links}>
            <Button
              component="a"
              href={reportUrl(run.job.id)}
              target="_blank"
              variant="default"
              size="compact-md"
              leftSection={<Icon name="file" size={14} />}
            >
              Report to print
            </Button>
            {answered && (
              <Button
                component="a"
                href={mapPageUrl(run.job.id, dark)}
                download
                variant="default"
                size="compact-md"
                leftSection={<Icon name="download" size={14} />}
              >
                3D scene page
              </Button>
            )}
          </div>
        </Section>
        <CommandSection jobId={run.job.id} />
        <Section title="Runs of this recording">
          <History runs={runs} shown={run.job.id} />
        </Section>
        <Compare key={run.job.id} recording={recording} runs={runs} shown={run.job.id} />
        {answered && <OwnLimitsSection />}
      </Panel>
    </>
  );
}

function Document({ recording, run, result }: { recording: Recording; run: Run; result: CalibrationResult }) {
  const [direction, setDirection] = useState<Direction>("imu_lidar");
  const pose = poseOf(result, direction);
  // What is weak has a list of its own; for those who read the file alone it is among the messages too.
  const outcome = run.job.result?.kind === "solve" ? run.job.result : null;
  const verdict = outcome?.verdict ?? "";
  const weak = new Set(result.observability.weak_directions?.map((one) => one.text));
  return (
    <div className={css.document}>
      <div>
        <Verdict result={result} text={verdict} />
        <OwnVerdict result={result} />
      </div>
      {toneOf(
        result.status,
        result.messages.map((message) => message.code),
      ) !== "good" && <NextSteps recording={recording} run={run} result={result} />}
      {pose !== null && <PoseCard pose={pose} result={result} direction={direction} onDirection={setDirection} />}
      <Messages
        messages={result.messages.filter(
          (message) =>
            !weak.has(message.text) &&
            !verdict.toLowerCase().includes(message.text.toLowerCase()) &&
            !isOfSensors(message),
        )}
      />
      <Advice observability={result.observability} />
      <OwnErrors result={result} solve={`/r/${recording.id}/solve?job=${run.job.id}`} />
      <PartsSection result={result} crossings={outcome?.stretches ?? ""} />
      <Quality result={result} asked={run.job.planes?.length ?? 0} />
    </div>
  );
}
