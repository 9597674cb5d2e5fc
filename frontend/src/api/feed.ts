import { useQuery, useQueryClient, type QueryClient } from "@tanstack/react-query";
import { useCallback, useEffect, useState } from "react";
import { readAnew } from "./anew";
import type { Planes, Recording, RecordingMessage } from "./client";
import { spoken } from "../ui/words";
import { keys } from "./queries";

/** Brings what is cached of a recording up to date with one message. */
export function applyMessage(client: QueryClient, id: string, message: RecordingMessage): void {
  switch (message.event) {
    case "planes-changed":
      void client.invalidateQueries({ queryKey: keys.planes(id) });
      // Runs call their planes by today's names.
      void client.invalidateQueries({ queryKey: keys.jobs(id) });
      void client.invalidateQueries({ queryKey: keys.runs(id) });
      return;
    case "click-refused":
      client.setQueryData<Refusal>(keys.refusal(id), {
        text: message.error.text,
        revision: client.getQueryData<Planes>(keys.planes(id))?.revision ?? 0,
      });
      return;
    case "view-changed":
      client.setQueryData(keys.view(id), message.view);
      return;
    case "job-changed":
      if (message.job.kind !== "audit" && message.job.kind !== "surface")
        client.setQueryData<Recording>(keys.recording(id), (old) =>
          old === undefined ? old : { ...old, latest_job: message.job },
        );
      // A report names the planes and says which way is up.
      void refresh(client, id, message.job.kind === "planes" || message.job.kind === "inspect");
      void client.invalidateQueries({ queryKey: keys.jobs(id) });
      void client.invalidateQueries({ queryKey: keys.runs(id) });
      return;
    case "recording-changed":
      if (message.deleted) client.removeQueries({ queryKey: keys.recording(id) });
      void refresh(client, id, true);
      void client.invalidateQueries({
        queryKey: keys.recording(id),
        predicate: ({ queryKey }) => queryKey.length > 2 && queryKey[2] !== keys.planes(id)[2],
      });
      void client.invalidateQueries({ queryKey: keys.recordings });
      return;
    case "resync":
      void client.invalidateQueries();
      return;
  }
}

/** The recording first: read anew it has no planes for a while, and who asked for them then would be refused. */
async function refresh(client: QueryClient, id: string, planes: boolean): Promise<void> {
  await readAnew(client, { queryKey: keys.recording(id), exact: true });
  if (!planes) return;
  const there = client.getQueryData<Recording>(keys.recording(id))?.has_planes === true;
  await client.invalidateQueries({ queryKey: keys.planes(id), refetchType: there ? "active" : "none" });
}

interface Refusal {
  text: string;
  /** Of the planes it was about: once they have changed it is no longer of interest. */
  revision: number;
}

/** Why the last click in the scene did nothing; null once the planes have changed, or it has been read. */
export function useClickRefusal(id: string, revision: number | undefined): [string | null, () => void] {
  const client = useQueryClient();
  const refusal = useQuery<Refusal | null>({
    queryKey: keys.refusal(id),
    queryFn: () => null,
    enabled: false,
    initialData: null,
  });
  const forget = useCallback(() => client.setQueryData<Refusal | null>(keys.refusal(id), null), [client, id]);
  return [refusal.data !== null && refusal.data.revision === revision ? refusal.data.text : null, forget];
}

/** A connection that comes back sooner than this, as after a laptop's sleep, is not worth a word. */
const patienceMs = 1500;

/** Keeps a recording's cached queries current while a component shows it, whoever changes it. Returns whether the server
 *  is out of reach: then nothing on the page is current. */
export function useRecordingFeed(id: string): boolean {
  const client = useQueryClient();
  const [lost, setLost] = useState(false);
  useEffect(() => {
    const source = new EventSource(`/api/recordings/${id}/events`);
    source.onmessage = (event: MessageEvent<string>) => {
      applyMessage(client, id, spoken(JSON.parse(event.data) as RecordingMessage));
    };
    let broke: number | null = null;
    source.onerror = () => {
      broke ??= window.setTimeout(() => setLost(true), patienceMs);
    };
    source.onopen = () => {
      if (broke !== null) {
        window.clearTimeout(broke);
        broke = null;
        setLost(false);
      }
      // What came to pass between what is known and now was told to nobody: a file that is no recording is refused in no time.
      void client.invalidateQueries({ queryKey: keys.recording(id) });
    };
    return () => {
      if (broke !== null) window.clearTimeout(broke);
      source.close();
    };
  }, [client, id]);
  return lost;
}
