import { queryOptions, useQuery } from "@tanstack/react-query";
import { api, body, told, type Limits, type Usual } from "./client";
import { asLimits, useOwnLimits } from "./ownlimits";

/** The thing an id belongs to comes first, so that everything of one recording can be refreshed at once. */
export const keys = {
  facts: ["facts"] as const,
  recordings: ["recordings"] as const,
  recording: (id: string) => ["recording", id] as const,
  planes: (id: string) => ["recording", id, "planes"] as const,
  editing: (id: string) => ["editing", id] as const,
  view: (id: string) => ["recording", id, "view"] as const,
  runs: (id: string) => ["recording", id, "runs"] as const,
  jobs: (id: string) => ["recording", id, "jobs"] as const,
  refusal: (id: string) => ["recording", id, "refusal"] as const,
  folder: (path: string) => ["folder", path] as const,
  result: (jobId: string) => ["result", jobId] as const,
  thickness: (jobId: string) => ["result", jobId, "thickness"] as const,
  scans: (jobId: string) => ["result", jobId, "scans"] as const,
  audit: (jobId: string) => ["audit", jobId] as const,
  command: (jobId: string) => ["result", jobId, "command"] as const,
  exported: (jobId: string, format: string) => ["result", jobId, "export", format] as const,
};

/** How a path of the API names a recording, and a job. */
export const of = (id: string) => ({ params: { path: { recording_id: id } } });
export const ofJob = (id: string) => ({ params: { path: { job_id: id } } });

export const factsQuery = queryOptions({
  queryKey: keys.facts,
  queryFn: () => told(api.GET("/api/info")),
  staleTime: Infinity,
});

/** Nothing is weak until the server has said what is. */
const unlimited: Limits = { rotation_deg: Infinity, translation_m: Infinity, time_offset_s: Infinity };

/** Beyond which standard deviation the server calls an axis weak. */
export function useUsualLimits(): Limits {
  return useQuery(factsQuery).data?.limits ?? unlimited;
}

/** Numbers of the server's own; none until it has told them. */
export function useUsual(): Usual | undefined {
  return useQuery(factsQuery).data?.usual;
}

/** Beyond which standard deviation an axis is not known well enough here: by one's own limits, where there are any. */
export function useLimits(): Limits {
  const usual = useUsualLimits();
  const { own } = useOwnLimits();
  return own === null ? usual : asLimits(own);
}

export const recordingsQuery = queryOptions({
  queryKey: keys.recordings,
  queryFn: () => told(api.GET("/api/recordings")),
});

export const recordingQuery = (id: string) =>
  queryOptions({
    queryKey: keys.recording(id),
    queryFn: () => told(api.GET("/api/recordings/{recording_id}", of(id))),
  });

export const viewQuery = (id: string) =>
  queryOptions({
    queryKey: keys.view(id),
    queryFn: () => told(api.GET("/api/recordings/{recording_id}/view", of(id))),
  });

export const runsQuery = (id: string) =>
  queryOptions({
    queryKey: keys.runs(id),
    queryFn: () => told(api.GET("/api/recordings/{recording_id}/runs", of(id))),
  });

export const jobsQuery = (id: string) =>
  queryOptions({
    queryKey: keys.jobs(id),
    queryFn: () => told(api.GET("/api/recordings/{recording_id}/jobs", of(id))),
  });

export const folderQuery = (path: string) =>
  queryOptions({
    queryKey: keys.folder(path),
    queryFn: () => told(api.GET("/api/folder", { params: { query: { path } } })),
  });

export const resultQuery = (jobId: string) =>
  queryOptions({
    queryKey: keys.result(jobId),
    queryFn: () => told(api.GET("/api/results/{job_id}", ofJob(jobId))),
    staleTime: Infinity,
  });

export const auditQuery = (jobId: string) =>
  queryOptions({
    queryKey: keys.audit(jobId),
    queryFn: () => told(api.GET("/api/audits/{job_id}", ofJob(jobId))),
    staleTime: Infinity,
  });

export const thicknessQuery = (jobId: string) =>
  queryOptions({
    queryKey: keys.thickness(jobId),
    queryFn: () => told(api.GET("/api/results/{job_id}/thickness", ofJob(jobId))),
    staleTime: Infinity,
  });

export const scansQuery = (jobId: string) =>
  queryOptions({
    queryKey: keys.scans(jobId),
    queryFn: () => told(api.GET("/api/results/{job_id}/scans", ofJob(jobId))),
    staleTime: Infinity,
    retry: false,
  });

export const commandQuery = (jobId: string) =>
  queryOptions({
    queryKey: keys.command(jobId),
    queryFn: () => body(api.GET("/api/results/{job_id}/command", ofJob(jobId))),
    staleTime: Infinity,
  });

export const exportQuery = (jobId: string, format: string) =>
  queryOptions({
    queryKey: keys.exported(jobId, format),
    queryFn: () =>
      body(
        api.GET("/api/results/{job_id}/export/{format_name}", {
          params: { path: { job_id: jobId, format_name: format } },
          parseAs: "text",
        }),
      ),
    staleTime: Infinity,
  });

export const resultDownloadUrl = (jobId: string) => `/api/results/${jobId}/download`;
/** What is seen at a place of the canvas, shares of it; "" for nothing, and where nobody answers. */
export async function askUnder(id: string, u: number, v: number): Promise<string> {
  const query = { u, v };
  try {
    return (
      await body(
        api.GET("/api/recordings/{recording_id}/view/under", { params: { path: { recording_id: id }, query } }),
      )
    ).text;
  } catch {
    return "";
  }
}

export const auditDownloadUrl = (jobId: string) => `/api/audits/${jobId}`;
export const reportUrl = (jobId: string) => `/api/results/${jobId}/report`;
export const mapPageUrl = (jobId: string, dark: boolean) => `/api/results/${jobId}/scene.html?dark=${dark}`;
export const viewPageUrl = (recordingId: string) => `/api/recordings/${recordingId}/scene.html`;
export const exportUrl = (jobId: string, format: string) => `/api/results/${jobId}/export/${format}`;
