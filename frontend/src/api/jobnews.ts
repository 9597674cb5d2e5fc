import type { QueryClient } from "@tanstack/react-query";
import type { Job, Recording } from "./client";
import { keys } from "./queries";

/** Brings what is cached of a recording up to date with a job of it that was started or moved, whoever tells of it. */
export function noteJob(client: QueryClient, recordingId: string, job: Job): void {
  // Which of its jobs tells where a recording stands after an audit or a surface, the server says.
  if (job.kind !== "audit" && job.kind !== "surface")
    client.setQueryData<Recording>(keys.recording(recordingId), (old) =>
      old === undefined ? old : { ...old, latest_job: job },
    );
  void client.invalidateQueries({ queryKey: keys.jobs(recordingId) });
  void client.invalidateQueries({ queryKey: keys.runs(recordingId) });
}
