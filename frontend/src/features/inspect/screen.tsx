import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useNavigate, useSearchParams } from "react-router";
import { viewQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { StateBox } from "../../ui/notice";
import { Panel } from "../../ui/panel";
import { useShortcuts } from "../../ui/shortcuts";
import { useWorkspace } from "../workspace/context";
import { chosenRun, isRefused } from "../workspace/state";
import { NudgeSection } from "./nudge";
import { ThicknessSection } from "./thickness";
import { Transport } from "./transport";
import { ViewBar } from "./viewbar";
import { fastestScan, useInspectView } from "./wish";

/** What the calibration does to the cloud: scan by scan, wall by wall, and what being wrong would cost. */
export function InspectScreen() {
  const { recording, runs, planes } = useWorkspace();
  const [query] = useSearchParams();
  const navigate = useNavigate();
  const run = chosenRun(runs, query.get("job"));
  const answered = run !== undefined && !isRefused(run);
  const { wish, change } = useInspectView(recording.id, answered ? run.job.id : null, fastestScan(recording.report?.timeline));
  const view = useQuery(viewQuery(recording.id)).data;
  const goOn = () => run !== undefined && void navigate(`/r/${recording.id}/result?job=${run.job.id}`);
  useShortcuts("Inspect", [{ keys: "Enter", label: "See the result", run: goOn }]);

  if (!answered) {
    return (
      <Panel title="Inspect">
        <StateBox title="There is no answer to look at">
          <p>{run === undefined ? "Solve first; the cloud before and after is shown here." : "This run was refused; its result says why."}</p>
        </StateBox>
      </Panel>
    );
  }
  const colors = new Map(planes?.patches.map((patch) => [patch.name, patch.color]) ?? []);
  return (
    <>
      <ViewBar wish={wish} change={change} />
      <Transport scan={wish.scan} scans={view?.n_scans ?? 0} timeS={view?.scan_t_s ?? null} points={view?.points_shown ?? 0} onScan={(scan) => change({ scan })} />
      <Panel
        title="Inspect"
        lead="A wall seen by a moving lidar is as thick as the motion is unknown."
        footer={
          <Button fullWidth onClick={goOn} rightSection={<Icon name="next" />}>
            See the result
          </Button>
        }
      >
        <ThicknessSection jobId={run.job.id} colors={colors} />
        <NudgeSection nudge={wish.nudge} blur={view?.blur ?? null} onChange={(nudge) => change({ nudge })} />
      </Panel>
    </>
  );
}
