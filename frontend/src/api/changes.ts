import { useMutation, useQueryClient, type QueryClient } from "@tanstack/react-query";
import {
  api,
  body,
  told,
  sparse,
  type ChangeRecording,
  type ChangeView,
  type ExtrinsicText,
  type NewAudit,
  type NewJob,
  type OpenRecording,
  type Recording,
  type View,
} from "./client";
import { noteJob } from "./jobnews";
import { keys, of, ofJob } from "./queries";
import { tab } from "./tab";

function rememberRecording(client: QueryClient, recording: Recording) {
  client.setQueryData(keys.recording(recording.id), recording);
  void client.invalidateQueries({ queryKey: keys.recordings });
}

export function useOpenRecording() {
  const client = useQueryClient();
  return useMutation({
    mutationFn: (wish: OpenRecording) => told(api.POST("/api/recordings", { body: wish })),
    onSuccess: (recording) => rememberRecording(client, recording),
  });
}

export function useChangeRecording(id: string) {
  const client = useQueryClient();
  return useMutation({
    mutationFn: (change: ChangeRecording) =>
      told(api.PATCH("/api/recordings/{recording_id}", { ...of(id), body: change })),
    onSuccess: (recording) => rememberRecording(client, recording),
  });
}

export function useDeleteRecording() {
  const client = useQueryClient();
  return useMutation({
    mutationFn: async (id: string) => {
      const { error, response } = await api.DELETE("/api/recordings/{recording_id}", of(id));
      if (!response.ok) await body(Promise.resolve({ error, response }));
    },
    onSuccess: () => client.invalidateQueries({ queryKey: keys.recordings }),
  });
}

export function useStartJob(id: string) {
  const client = useQueryClient();
  return useMutation({
    mutationFn: (wish: Partial<NewJob>) =>
      told(api.POST("/api/recordings/{recording_id}/jobs", { ...of(id), body: sparse(wish) })),
    onSuccess: (job) => noteJob(client, job.recording_id, job),
  });
}

export function useStartAudit(id: string) {
  const client = useQueryClient();
  return useMutation({
    mutationFn: (wish: NewAudit) => told(api.POST("/api/recordings/{recording_id}/audits", { ...of(id), body: wish })),
    onSuccess: (job) => noteJob(client, job.recording_id, job),
  });
}

export function useCancelJob() {
  const client = useQueryClient();
  return useMutation({
    mutationFn: (jobId: string) => told(api.POST("/api/jobs/{job_id}/cancel", ofJob(jobId))),
    onSuccess: (job) => noteJob(client, job.recording_id, job),
  });
}

export function useRetryJob() {
  const client = useQueryClient();
  return useMutation({
    mutationFn: (jobId: string) => told(api.POST("/api/jobs/{job_id}/retry", ofJob(jobId))),
    onSuccess: (job) => noteJob(client, job.recording_id, job),
  });
}

/** Pasted or uploaded text as an extrinsic; a URDF's links are found by the frames of the recording that it is meant for. */
export function useReadExtrinsic(recordingId: string) {
  return useMutation({
    mutationFn: (wish: ExtrinsicText) =>
      told(api.POST("/api/extrinsic", { params: { query: { recording_id: recordingId } }, body: wish })),
  });
}

export function useChangeView(id: string) {
  const client = useQueryClient();
  return useMutation({
    // One after the other: two changes at once could each undo the other's part of the view.
    scope: { id: `view-${id}` },
    mutationFn: (change: Partial<ChangeView>) =>
      told(
        api.POST("/api/recordings/{recording_id}/view", {
          params: { ...of(id).params, query: { tab } },
          body: sparse(change),
        }),
      ),
    onSuccess: (view: View) => client.setQueryData(keys.view(id), view),
  });
}
