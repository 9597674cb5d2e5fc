import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link, useNavigate, useSearchParams } from "react-router";
import type { Recording, Run } from "../../api/client";
import { sparse } from "../../api/client";
import { isFinal } from "../../api/jobstream";
import { useStartJob } from "../../api/changes";
import { scansQuery, viewQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { StateBox } from "../../ui/notice";
import { Panel } from "../../ui/panel";
import { useShortcuts } from "../../ui/shortcuts";
import { useWorkspace, type Workspace } from "../workspace/context";
import { chosenRun, isRefused } from "../workspace/state";
import { ExcludeSection } from "./exclude";
import { NudgeSection } from "./nudge";
import { OldSection } from "./old";
import { nameOfOld } from "./oldtext";
import { ScanStrip } from "./scanstrip";
import { badScans, joined, spansOf, type TimeSpan } from "./spans";
import { ThicknessSection } from "./thickness";
import { Transport } from "./transport";
import { ViewBar } from "./viewbar";
import { Wipe } from "./wipe";
import css from "./inspect.module.css";
import { fastestScan, useInspectView } from "./wish";

/** What the calibration does to the cloud: scan by scan, wall by wall, and what being wrong would cost. */
export function InspectScreen() {
  const workspace = useWorkspace();
  const [query] = useSearchParams();
  const run = chosenRun(workspace.runs, query.get("job"));
  if (run === undefined || isRefused(run)) {
    return (
      <Panel title="Inspect">
        <StateBox title="There is no answer to look at">
          <p>{whyNothing(run, workspace.recording)}</p>
          {run !== undefined && (
            <Button
              component={Link}
              to={`/r/${workspace.recording.id}/result?job=${run.job.id}`}
              variant="default"
              mt="sm"
            >
              See why
            </Button>
          )}
        </StateBox>
      </Panel>
    );
  }
  return <Inspection key={run.job.id} run={run} {...workspace} />;
}

/** Why there is nothing to inspect: of a solve that runs already it is not asked for one. */
export function whyNothing(run: Run | undefined, recording: Pick<Recording, "latest_job">): string {
  const job = recording.latest_job ?? null;
  if (job?.kind === "solve" && !isFinal(job))
    return "The solve is still running; the cloud before and after is shown here once it has an answer.";
  return run === undefined
    ? "Solve first; the cloud before and after is shown here."
    : "This run was refused; its result says why.";
}

function Inspection({ run, recording, returns }: Workspace & { run: Run }) {
  const [query] = useSearchParams();
  const navigate = useNavigate();
  const firstScan = fastestScan(recording.report?.timeline);
  const { wish, change } = useInspectView(recording.id, run.job.id, firstScan, returns);
  const view = useQuery(viewQuery(recording.id)).data;
  // What the scene shows lags behind the wish; what it says of another scan must not stand beside this one's number.
  const shown = view?.mode === "inspect" && view.scan === wish.scan ? view : undefined;
  const quality = useQuery(scansQuery(run.job.id)).data;
  const start = useStartJob(recording.id);
  const done = spansOf(run);
  // Until something else is wished for, the next solve would leave out what this one did.
  const wished = query.has("out") ? wish.leaveOut : done;
  const setWished = (spans: TimeSpan[]) => change({ leaveOut: spans });
  const times = quality?.t_s ?? [];
  const periodS = times.length > 1 ? (times.at(-1) ?? 0) / (times.length - 1) : 0.1;
  const bad = badScans(quality?.rms_m ?? []);
  const worst = worstOf(quality?.rms_m ?? []);
  const goOn = () => void navigate(`/r/${recording.id}/result?job=${run.job.id}`);
  const solve = () =>
    start.mutate(
      {
        kind: "solve",
        settings: sparse({
          ...run.job.settings,
          excluded_spans_s: wished.map(([from, to]): [number, number] => [from, to]),
        }),
      },
      { onSuccess: (job) => void navigate(`/r/${recording.id}/solve?job=${job.id}`) },
    );
  const nextBad = () => {
    const next = bad.find((place) => place > wish.scan) ?? bad.at(0) ?? worst;
    if (next !== null) change({ scan: next });
  };
  useShortcuts("Inspect", [
    { keys: "Enter", label: "See the result", run: goOn },
    { keys: "n", label: "Next scan that stands out", run: nextBad },
  ]);
  const planes = run.job.planes ?? [];
  const colors = new Map(planes.map((plane) => [plane.name, plane.color]));
  const names = new Map(planes.map((plane) => [plane.name, plane.title]));
  return (
    <>
      <ViewBar recordingId={recording.id} wish={wish} change={change} />
      {wish.show === "wipe" && (
        <Wipe
          share={wish.wipe}
          left={wish.against === "old" ? nameOfOld(wish.old, "Old extrinsic") : "Raw"}
          right="De-skewed"
          onChange={(wipe) => change({ wipe })}
        />
      )}
      <div className={css.dock}>
        <ScanStrip
          jobId={run.job.id}
          scan={wish.scan}
          wished={wished}
          excluded={done}
          onScan={(scan) => change({ scan, extent: "scan" })}
          onLeaveOut={(span) => setWished(joined(wished, span))}
        />
        <Transport
          scan={wish.scan}
          scans={view?.n_scans ?? 0}
          timeS={times[wish.scan] ?? shown?.scan_t_s ?? null}
          points={shown?.points_shown ?? 0}
          onScan={(scan) => change({ scan })}
        />
      </div>
      <Panel
        title="Inspect"
        lead="The less accurate the motion is, the thicker a wall looks to a moving lidar."
        footer={
          <Button fullWidth onClick={goOn} rightSection={<Icon name="next" />}>
            See the result
          </Button>
        }
      >
        <ThicknessSection jobId={run.job.id} colors={colors} names={names} />
        <NudgeSection nudge={wish.nudge} blur={view?.blur ?? null} onChange={(nudge) => change({ nudge })} />
        <ExcludeSection
          wished={wished}
          done={done}
          scan={wish.scan}
          scanTimeS={times[wish.scan] ?? shown?.scan_t_s ?? null}
          periodS={periodS}
          worst={worst}
          onScan={(scan) => change({ scan, extent: "scan" })}
          onChange={setWished}
          onSolve={solve}
          pending={start.isPending}
          error={start.error}
        />
        <OldSection
          recordingId={recording.id}
          old={wish.old}
          blur={view?.old_blur ?? null}
          onChange={(old) =>
            change(
              old === null
                ? { old, against: "raw", show: wish.show === "old" ? "both" : wish.show }
                : { old, against: "old", show: "wipe" },
            )
          }
        />
      </Panel>
    </>
  );
}

function worstOf(rms: readonly (number | null)[]): number | null {
  return rms.reduce<number | null>(
    (best, value, i) => (value !== null && (best === null || value > (rms[best] ?? 0)) ? i : best),
    null,
  );
}
