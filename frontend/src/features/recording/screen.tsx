import { Button, Skeleton } from "@mantine/core";
import { Link, useNavigate } from "react-router";
import type { Job, Recording } from "../../api/client";
import { isFinal, useJobStream } from "../../api/jobstream";
import { useChangeRecording, useDeleteRecording, useRetryJob } from "../../api/changes";
import { bytes, duration } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { Fault, Notice, StateBox } from "../../ui/notice";
import { Panel, Section } from "../../ui/panel";
import { useShortcuts } from "../../ui/shortcuts";
import { JobProgress } from "../jobs/progress";
import { useDropZone } from "../start/dropzone";
import { useUploads } from "../start/uploads";
import { rateOf } from "../start/rate";
import { useWorkspace, type Workspace } from "../workspace/context";
import layout from "../workspace/layout.module.css";
import { hasArrived } from "../workspace/state";
import { Note } from "./note";
import { Report } from "./report";
import { Reading } from "./reading";
import { lacksSensor, openChoices, Sensors } from "./sensors";
import css from "./recording.module.css";

/** What the recording holds, what stands in its way, and which part of it to use. */
export function RecordingScreen() {
  const { recording, jobs, planes } = useWorkspace();
  const navigate = useNavigate();
  const goOn = () => void navigate(`/r/${recording.id}/planes`);
  const arrived = hasArrived(recording);
  const { report } = recording;
  // Without a sensor there is nothing to look for planes in.
  const choosing = report !== null && report !== undefined && openChoices(report).length > 0;
  const lacking = lacksSensor(report);
  useShortcuts(
    "Recording",
    arrived && !lacking
      ? [
          ...(choosing ? [] : [{ keys: "Enter", label: "Choose planes", run: goOn }]),
          { keys: "a", label: "Audit an extrinsic", run: () => void navigate(`/r/${recording.id}/audit`) },
        ]
      : [],
  );
  return (
    <>
      <div className={layout.main}>
        <div className={layout.pad}>
          <Main recording={recording} jobs={jobs} planes={planes} />
        </div>
      </div>
      <Panel
        title="Sensors"
        footer={
          lacking ? (
            <Button fullWidth component={Link} to="/" variant="default">
              Open another recording
            </Button>
          ) : (
            <Button
              fullWidth
              disabled={!arrived || choosing}
              variant={report?.final === true && report.verdict === "unusable" ? "default" : "filled"}
              onClick={goOn}
              rightSection={<Icon name="next" />}
            >
              Choose planes
            </Button>
          )
        }
      >
        <Section title="File">
          <p className={css.file}>
            <span className="clip" title={recording.name}>
              {recording.name}
            </span>
            <span className="num dim nowrap">
              {recording.size_bytes > 0 && bytes(recording.size_bytes)}
              {recording.report !== null &&
                recording.report !== undefined &&
                `, ${duration(recording.report.duration_s)}`}
            </span>
          </p>
          <Note key={recording.note} recording={recording} />
        </Section>
        {arrived && !lacking && (
          <Section title="In use already?">
            <div className={css.audit}>
              <p className="dim small">Hold the extrinsic that you use now against this recording.</p>
              <Button component={Link} to={`/r/${recording.id}/audit`} size="compact-sm" variant="default">
                Audit an extrinsic
              </Button>
            </div>
          </Section>
        )}
        <Sensors recording={recording} />
        {hasArrived(recording) || (recording.state === "failed" && !isNoRecording(recording)) ? (
          <Reading recording={recording} />
        ) : null}
      </Panel>
    </>
  );
}

function Main({ recording, jobs, planes }: Pick<Workspace, "recording" | "jobs" | "planes">) {
  const inspection = jobs?.find((job) => job.kind === "inspect") ?? null;
  const { state, report } = recording;
  switch (state) {
    case "receiving":
      return <Receiving recording={recording} />;
    case "failed":
      return <Failed recording={recording} job={inspection ?? recording.latest_job ?? null} />;
    case "inspecting":
    case "ready":
      // While it is read, a final report is one of how it was read before.
      return report && report.final === (state === "ready") ? (
        <Report recording={recording} report={report} planes={planes}>
          <Inspecting job={inspection} />
        </Report>
      ) : (
        <Inspecting job={inspection} />
      );
  }
}

/** What arrives: bytes from a browser, or a sample that is made on the spot. */
function Receiving({ recording }: { recording: Recording }) {
  return recording.origin === "sample" ? (
    <Inspecting job={recording.latest_job ?? null} />
  ) : (
    <Uploading recording={recording} />
  );
}

function Uploading({ recording }: { recording: Recording }) {
  const { list, cancel } = useUploads();
  const { chooseFile } = useDropZone();
  const remove = useDeleteRecording();
  const navigate = useNavigate();
  const upload = list.find((one) => one.recordingId === recording.id);
  const rate = rateOf(upload?.samples ?? [], recording.size_bytes);
  const sent = upload === undefined ? recording.received_bytes : rate.sent;
  const percent = recording.size_bytes === 0 ? 0 : Math.floor((100 * sent) / recording.size_bytes);
  return (
    <StateBox
      title={upload === undefined ? "This upload was interrupted" : "Uploading"}
      icon={<Icon name="upload" size={32} />}
    >
      <div className={css.upload}>
        <div
          className={css.uploadBar}
          role="progressbar"
          aria-label="Upload"
          aria-valuenow={percent}
          aria-valuemin={0}
          aria-valuemax={100}
        >
          <span style={{ transform: `scaleX(${percent / 100})` }} />
        </div>
        <p className="num">
          {bytes(sent)} of {bytes(recording.size_bytes)}
          {rate.bytesPerSecond !== null && `, ${bytes(rate.bytesPerSecond)}/s`}
          {rate.secondsLeft !== null && `, ${duration(rate.secondsLeft)} left`}
        </p>
        {upload?.waiting === true && (
          <p role="status">This machine is on no network. The upload goes on by itself when it is on one again.</p>
        )}
        {upload === undefined ? (
          <>
            <p>
              Choose or drop the same file again, {recording.name}:{" "}
              {sent === 0 ? "it begins anew, for none of it had arrived." : "it goes on from there."}
            </p>
            <div className={css.uploadActions}>
              <Button size="compact-sm" leftSection={<Icon name="file" size={13} />} onClick={chooseFile}>
                Choose the file
              </Button>
              <Button
                size="compact-sm"
                variant="default"
                leftSection={<Icon name="trash" size={13} />}
                loading={remove.isPending}
                onClick={() => remove.mutate(recording.id, { onSuccess: () => void navigate("/") })}
              >
                Discard it
              </Button>
            </div>
            {remove.isError && <Fault error={remove.error} />}
          </>
        ) : (
          <Button
            size="compact-sm"
            variant="default"
            onClick={() => {
              cancel(recording.id);
              void navigate("/");
            }}
          >
            Cancel
          </Button>
        )}
        {upload?.fault !== null && upload?.fault !== undefined && <Fault error={upload.fault} />}
      </div>
    </StateBox>
  );
}

/** A sample is written by the stage that writes results. */
const simulated = { write: "Simulate the sensors" };

function Inspecting({ job }: { job: Job | null }) {
  const run = useJobStream(job !== null && !isFinal(job) ? job.id : null);
  return (
    <div className={css.inspecting}>
      <h1>{job?.kind === "simulate" ? "Making the sample" : "Reading the recording"}</h1>
      {job === null ? (
        <Skeleton height={120} />
      ) : (
        <JobProgress
          run={run}
          jobId={job.id}
          expected={job.kind === "simulate" ? ["write"] : ["inspect"]}
          titles={job.kind === "simulate" ? simulated : {}}
        />
      )}
    </div>
  );
}

/** Whether the file itself cannot be opened, so that not even its topics are known: saying how its sensors are read helps nothing. */
export function isNoRecording({ error, report }: Pick<Recording, "error" | "report">): boolean {
  return error?.code === "recording.unreadable" && (report === null || report === undefined);
}

function Failed({ recording, job }: { recording: Recording; job: Job | null }) {
  const retry = useRetryJob();
  const change = useChangeRecording(recording.id);
  const candidates = recording.error?.details?.candidates ?? [];
  // What was stopped says nothing of the recording.
  const stopped = job?.state === "interrupted" || job?.state === "cancelled";
  // A file that was sent stays as it is; one in the server's folder may have been mended since.
  const helpless = !stopped && isNoRecording(recording) && recording.origin === "upload";
  return (
    <div className={css.failed}>
      <h1>
        {stopped
          ? "This recording has not been read yet"
          : isNoRecording(recording)
            ? "This file cannot be read"
            : "This recording cannot be used as it is"}
      </h1>
      <Notice level={stopped ? "warning" : "error"}>
        {recording.error?.text ?? "The server gave no reason; its log says more."}
      </Notice>
      <div className={css.failedActions}>
        {job !== null && !helpless && (
          <Button
            variant={stopped ? "filled" : "default"}
            loading={retry.isPending}
            onClick={() => retry.mutate(job.id)}
          >
            Try again
          </Button>
        )}
        <Button component={Link} to="/" variant={helpless ? "filled" : "default"}>
          Open another one
        </Button>
      </div>
      {candidates.length > 0 && <p className="dim small">Topics that were considered: {candidates.join(", ")}</p>}
      {[retry.error, change.error].map((error, i) => error !== null && <Fault key={i} error={error} />)}
    </div>
  );
}
