import { Button, Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect } from "react";
import { Link, Outlet, useLocation, useParams, useSearchParams } from "react-router";
import { useRecordingFeed } from "../../api/feed";
import { planesQuery } from "../../api/planes";
import { jobsQuery, recordingQuery, runsQuery } from "../../api/queries";
import { LevelIcon } from "../../ui/icons";
import { Fault, StateBox } from "../../ui/notice";
import { Shell } from "../../ui/shell";
import type { StepName } from "../../ui/stepper";
import type { Workspace } from "./context";
import css from "./layout.module.css";
import { lacksSensor } from "../recording/sensors";
import { NotFound } from "./notfound";
import { useReturns } from "./returns";
import { ScenePane } from "./scene";
import { useSeen } from "./seen";
import { chosenRun, hasArrived, isRecordingId, stepsOf } from "./state";

const stepNames: readonly StepName[] = ["recording", "planes", "solve", "inspect", "result"];
const withScene: readonly StepName[] = ["planes", "solve", "inspect"];

/** The recording that the address names. A link that was cut off names none, of which the server need not be asked. */
export function WorkspaceLayout() {
  const { recordingId = "" } = useParams();
  return isRecordingId(recordingId) ? <OneRecording recordingId={recordingId} /> : <NotFound />;
}

/** Everything of one recording: steps on top, the 3D scene kept alive across the screens that show it. */
function OneRecording({ recordingId }: { recordingId: string }) {
  const { pathname } = useLocation();
  const [query] = useSearchParams();
  const [seen, look] = useSeen();
  const current = stepNames.find((name) => pathname.endsWith(`/${name}`)) ?? null;
  const screen = pathname.endsWith("/audit") ? "audit" : current;
  const recording = useQuery(recordingQuery(recordingId));
  // Its first cloud is there before its report is.
  const arrived = hasArrived(recording.data);
  const jobs = useQuery({ ...jobsQuery(recordingId), enabled: arrived || recording.data?.state === "failed" });
  // Before they have been found there are none to ask for.
  const planes = useQuery({ ...planesQuery(recordingId), enabled: recording.data?.has_planes === true });
  const runs = useQuery({ ...runsQuery(recordingId), enabled: arrived });
  const lost = useRecordingFeed(recordingId);
  const [returns, back] = useReturns(recordingId, current !== null && withScene.includes(current) ? current : null);

  const name = recording.data?.name;
  useEffect(() => {
    document.title = name === undefined ? "unsweep" : `${name} · unsweep`;
    return () => {
      document.title = "unsweep";
    };
  }, [name]);

  const showsScene = current !== null && withScene.includes(current) && arrived && !lacksSensor(recording.data?.report);
  const steps = stepsOf(recording.data, planes.data, runs.data?.runs ?? [], "", seen);
  const looked = current === "inspect" || current === "result" ? current : null;
  const lookedRun = chosenRun(runs.data?.runs ?? [], query.get("job"))?.job.id;
  useEffect(() => {
    if (looked !== null && lookedRun !== undefined) look(looked, lookedRun);
  }, [look, looked, lookedRun]);
  return (
    <Shell steps={steps} current={current} {...(name === undefined ? {} : { recordingName: name })}>
      <main className={css.workspace} data-screen={screen ?? "none"}>
        {lost && recording.data !== undefined && (
          <div className={css.lost} role="alert">
            <LevelIcon level="warning" />
            The server does not answer; see that `unsweep serve` is running. This page goes on by itself once it is
            back.
          </div>
        )}
        {arrived && <ScenePane recordingId={recordingId} visible={showsScene} mode={current} onEntered={back} />}
        {recording.isPending ? (
          <WorkspaceSkeleton />
        ) : recording.isError ? (
          <div className={css.whole}>
            <StateBox title="This recording cannot be shown">
              <Fault error={recording.error} onRetry={() => void recording.refetch()} />
              <Button component={Link} to="/" variant="default" mt="md">
                Back to the recordings
              </Button>
            </StateBox>
          </div>
        ) : (
          <Outlet
            context={
              {
                recording: recording.data,
                planes: recording.data.has_planes ? planes.data : undefined,
                jobs: jobs.data,
                runs: runs.data?.runs ?? [],
                returns,
              } satisfies Workspace
            }
          />
        )}
      </main>
    </Shell>
  );
}

function WorkspaceSkeleton() {
  return (
    <>
      <div className={css.main} role="status" aria-busy="true" aria-label="Loading">
        <div className={css.pad}>
          <Skeleton height={26} width="46%" mb={18} />
          <Skeleton height={150} mb={18} />
          <Skeleton height={88} mb={10} />
          <Skeleton height={88} />
        </div>
      </div>
      <div className={css.side}>
        <Skeleton height={24} width="60%" mb={18} />
        <Skeleton height={120} />
      </div>
    </>
  );
}
