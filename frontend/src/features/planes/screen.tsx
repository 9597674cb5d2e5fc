import { ActionIcon, Button, Skeleton, Tooltip } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useRef } from "react";
import { Link, useNavigate } from "react-router";
import type { DoctorReport, Operation, Planes, Recording } from "../../api/client";
import { isFinal, useJobStream } from "../../api/jobstream";
import { asFault } from "../../api/fault";
import { useClickRefusal } from "../../api/feed";
import { useChangeView, useStartJob } from "../../api/changes";
import { useEditPlanes } from "../../api/planes";
import { resultQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { Fault, Notice, StateBox } from "../../ui/notice";
import { Panel } from "../../ui/panel";
import { useShortcuts } from "../../ui/shortcuts";
import { planesOf } from "../../ui/words";
import { JobProgress } from "../jobs/progress";
import { stagesOfPlanes } from "../jobs/timeleft";
import { lacksSensor } from "../recording/sensors";
import { standingOf } from "../start/standing";
import { useWorkspace } from "../workspace/context";
import layout from "../workspace/layout.module.css";
import { ClickMode } from "./clickmode";
import { determines, DeterminacyMeter } from "./determinacy";
import { cautionOf, lastSolve, remarksOf } from "./leftout";
import { PatchList } from "./list";
import css from "./planes.module.css";

/** The planes, or why none are looked for. */
export function PlanesScreen() {
  const { recording } = useWorkspace();
  return lacksSensor(recording.report) ? (
    <div className={layout.whole}>
      <StateBox title="There is nothing to choose planes for">
        <p>{recording.report?.reasons[0]}</p>
        <BackToRecording id={recording.id} />
      </StateBox>
    </div>
  ) : (
    <PlanesOf />
  );
}

/** The static cloud with its planes: confirm, drop, grow, merge, and see whether they determine the answer. */
function PlanesOf() {
  const { recording, planes, jobs, runs, returns } = useWorkspace();
  const navigate = useNavigate();
  const { mutate: changeView } = useChangeView(recording.id);
  const edit = useEditPlanes(recording.id);
  // Of its own: what is wrong with a name is said at the name, and of nothing else.
  const naming = useEditPlanes(recording.id);
  const start = useStartJob(recording.id);
  const job = jobs?.find((one) => one.kind === "planes") ?? null;
  const running = job !== null && !isFinal(job);
  const searching = running && planes === undefined;
  const [refusal, forgetRefusal] = useClickRefusal(recording.id, planes?.revision);

  const last = lastSolve(runs);
  const told = useQuery({ ...resultQuery(last?.run.job.id ?? ""), enabled: last !== null }).data;
  const remarks =
    last === null || told === undefined || planes === undefined
      ? undefined
      : remarksOf(planes.patches, last.run, last.number, told);

  useEffect(() => {
    changeView({ mode: "planes", click: "toggle", nudge: null });
  }, [changeView, returns]);

  // Looking for planes needs no decision, so nobody is asked.
  const asked = useRef(false);
  const { mutate: startJob } = start;
  const ready = recording.state === "ready";
  useEffect(() => {
    if (!ready || jobs === undefined || job !== null || asked.current) return;
    asked.current = true;
    startJob({ kind: "planes" });
  }, [ready, jobs, job, startJob]);

  const solve = () =>
    start.mutate({ kind: "solve" }, { onSuccess: (made) => void navigate(`/r/${recording.id}/solve?job=${made.id}`) });
  const apply = (operation: Operation) => edit.mutate(operation);
  const confirmed = planes?.patches.filter((patch) => patch.confirmed).length ?? 0;
  useShortcuts(
    "Planes",
    planes === undefined
      ? []
      : [
          { keys: "s", label: "Use the suggestion", run: () => apply({ op: "use-suggestion" }) },
          { keys: "mod+z", label: "Undo", run: () => (planes.can_undo || edit.isPending) && apply({ op: "undo" }) },
          { keys: "mod+shift+z", label: "Redo", run: () => planes.can_redo && apply({ op: "redo" }) },
          { keys: "Enter", label: "Solve with these planes", run: () => confirmed > 0 && solve() },
          ...planes.patches.slice(0, 10).map((patch) => ({
            keys: `alt+${(patch.index + 1) % 10}`,
            label: `Confirm or drop ${patch.name}`,
            run: () => apply({ op: patch.confirmed ? "drop" : "confirm", index: patch.index }),
          })),
        ],
  );

  // The doctor's reason, where a solve would be refused whatever is confirmed.
  const report = recording.report ?? null;
  const hopeless = report?.final === true && report.verdict === "unusable" ? (report.reasons[0] ?? "") : "";
  const caution = planes === undefined ? "" : cautionOf(planes.patches, remarks);
  const sound = planes !== undefined && hopeless === "" && caution === "" && determines(planes);
  return (
    <>
      {planes !== undefined && <ClickMode recordingId={recording.id} planes={planes} onSet={forgetRefusal} />}
      {refusal !== null ? (
        <Said level="warning" text={refusal} onRead={forgetRefusal} />
      ) : (
        edit.isError && <Said level="error" text={asFault(edit.error).message} onRead={edit.reset} />
      )}
      <Panel
        title="Planes"
        lead="Keep walls, floor and ceiling; drop what can move or bend."
        tools={planes !== undefined && <History planes={planes} apply={apply} />}
        footer={
          planes === undefined ? (
            <Button disabled fullWidth>
              Solve
            </Button>
          ) : confirmed === 0 ? (
            <NoneConfirmed
              found={planes.patches.length}
              onSuggestion={() => apply({ op: "use-suggestion" })}
              onGrow={() => changeView({ click: "grow" })}
            />
          ) : (
            <Button
              fullWidth
              onClick={solve}
              loading={start.isPending}
              variant={sound ? "filled" : "default"}
              rightSection={<Icon name="next" />}
            >
              {sound ? `Solve with ${planesOf(confirmed)}` : `Solve with ${confirmed} anyway`}
            </Button>
          )
        }
      >
        {start.isError && <Fault error={start.error} />}
        {planes !== undefined ? (
          <>
            <DeterminacyMeter {...planes} hopeless={hopeless} caution={caution} />
            {!planes.static && (
              <div className={css.gap}>
                <Notice level="warning">{fewScansText(report)}</Notice>
              </div>
            )}
            <PatchList
              planes={planes}
              {...(remarks === undefined ? {} : { remarks })}
              apply={apply}
              rename={(index, name) => naming.mutateAsync({ op: "rename", index, name })}
              onRestrict={(target) => changeView({ click: "restrict", target })}
            />
            {planes.restricted && (
              <p className={css.region}>
                <Icon name="box" size={14} />
                <span>A box leaves part of the room out, in the solve too. Undo it, or use the suggestion.</span>
              </p>
            )}
            <p className={css.background} aria-live="polite">
              {running ? "The rest of the recording is still being read; nothing here waits for it." : ""}
            </p>
            {job !== null && job.state === "failed" && (
              <Notice level="error">{job.error?.text ?? job.state_text}</Notice>
            )}
          </>
        ) : searching ? (
          <PlanesProgress jobId={job.id} />
        ) : job !== null && (job.state === "failed" || job.state === "cancelled" || job.state === "interrupted") ? (
          <Notice
            level={job.state === "failed" ? "error" : "warning"}
            actions={
              <>
                <BackToRecording id={recording.id} />
                <Button size="compact-sm" variant="default" onClick={() => startJob({ kind: "planes" })}>
                  Look again
                </Button>
              </>
            }
          >
            {job.error?.text ?? job.state_text}
          </Notice>
        ) : recording.state === "receiving" || recording.state === "failed" ? (
          <NotHere recording={recording} />
        ) : (
          <ListSkeleton />
        )}
      </Panel>
    </>
  );
}

/** Why these planes come from few scans. That is the lidar's standstill, at the scan that shows most planes; the IMU, whose noise the
 *  recording's page tells, may have one at another time. */
export function fewScansText(report: Pick<DoctorReport, "imu"> | null): string {
  const imu = report?.imu ?? null;
  const still = imu !== null && (imu.noise_used === "measured" || imu.still_spans.length > 0);
  return `No standstill was found around these planes, so that they come from few scans; the solve refines them.${
    still ? " The standstill in the IMU’s readings is at another time, or too few planes show it." : ""
  }`;
}

/** Without a plane there is nothing to solve with: why, and the way to some. */
export function NoneConfirmed(props: { found: number; onSuggestion: () => void; onGrow: () => void }) {
  const { found, onSuggestion, onGrow } = props;
  return (
    <div className={css.none}>
      <p>
        {found === 0
          ? "A solve needs planes, and none was found: click the cloud where it is flat to grow one."
          : "A solve needs planes, and none is confirmed: tick some above, or take the suggestion."}
      </p>
      {found === 0 ? (
        <Button fullWidth onClick={onGrow}>
          Grow a plane
        </Button>
      ) : (
        <Button fullWidth onClick={onSuggestion}>
          Use the suggestion
        </Button>
      )}
    </div>
  );
}

/** Why nothing happened, over the scene: in the list it would push the rows away from under the mouse. */
function Said({ level, text, onRead }: { level: "warning" | "error"; text: string; onRead: () => void }) {
  return (
    <div className={css.said} role={level === "warning" ? "status" : undefined}>
      <Notice level={level}>{text}</Notice>
      <ActionIcon size="sm" variant="subtle" color="gray" aria-label="Close the message" onClick={onRead}>
        <Icon name="cross" size={12} />
      </ActionIcon>
    </div>
  );
}

function History({ planes, apply }: { planes: Planes; apply: (operation: Operation) => void }) {
  return (
    <div className={css.tools}>
      <Tooltip label="Back to the planes as detected (S)">
        <Button size="compact-sm" variant="default" onClick={() => apply({ op: "use-suggestion" })}>
          Use suggestion
        </Button>
      </Tooltip>
      <Tooltip label="Undo (Ctrl Z)">
        <ActionIcon
          variant="default"
          aria-label="Undo"
          disabled={!planes.can_undo}
          onClick={() => apply({ op: "undo" })}
        >
          <Icon name="undo" />
        </ActionIcon>
      </Tooltip>
      <Tooltip label="Redo (Ctrl Shift Z)">
        <ActionIcon
          variant="default"
          aria-label="Redo"
          disabled={!planes.can_redo}
          onClick={() => apply({ op: "redo" })}
        >
          <Icon name="redo" />
        </ActionIcon>
      </Tooltip>
    </div>
  );
}

/** Why nothing is looked for: whoever reloads a page that sends has cut the upload, and would wait for planes for ever. */
export function NotHere({ recording }: { recording: Recording }) {
  const { text, tone } = standingOf(recording);
  return (
    <Notice level={tone === "error" ? "error" : "warning"} actions={<BackToRecording id={recording.id} />}>
      {`${text}: there are no planes before the recording has been read.`}
    </Notice>
  );
}

/** Where what keeps planes from being found is chosen and put right. */
function BackToRecording({ id }: { id: string }) {
  return (
    <Button component={Link} to={`/r/${id}/recording`} size="compact-sm" variant="default">
      Back to the recording
    </Button>
  );
}

function PlanesProgress({ jobId }: { jobId: string }) {
  const run = useJobStream(jobId);
  return (
    <>
      <JobProgress run={run} jobId={jobId} expected={stagesOfPlanes} />
      <ListSkeleton />
    </>
  );
}

function ListSkeleton() {
  return (
    <div role="status" aria-busy="true" aria-label="Looking for planes">
      {[0, 1, 2, 3, 4, 5].map((i) => (
        <Skeleton key={i} height={40} mt={10} />
      ))}
    </div>
  );
}
