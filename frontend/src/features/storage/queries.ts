import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { api, sparse, told } from "../../api/client";
import type { components } from "../../api/generated/schema";

export type StorageUse = components["schemas"]["StorageUse"];
export type RecordingUse = components["schemas"]["RecordingUse"];

const key = ["storage"] as const;

export const storageQuery = queryOptions({
  queryKey: key,
  queryFn: () => told(api.GET("/api/storage")),
  refetchInterval: 10_000,
});

/** Ask anew what takes room. */
export function useRefreshStorage() {
  const client = useQueryClient();
  return () => void client.invalidateQueries({ queryKey: key });
}

/** A link that shows the recording to whoever has it, for as long as the server usually lets it. */
export function useShare(id: string) {
  return useMutation({
    mutationFn: () =>
      told(
        api.POST("/api/recordings/{recording_id}/share", {
          params: { path: { recording_id: id } },
          body: sparse<components["schemas"]["NewShareLink"]>({}),
        }),
      ),
  });
}
