import { useQuery, useQueryClient, type QueryClient } from "@tanstack/react-query";
import { useCallback, useEffect, useState } from "react";
import { readAnew } from "./anew";
import type { Planes, Recording, RecordingMessage } from "./client";
import { spoken } from "../ui/words";
import { noteJob } from "./jobnews";
import { keys } from "./queries";

/** Reads a recording anew, one reading at a time: who asks while one is on its way is served by one more after it.
 *
 *  The recording first, then its planes: read anew it has none for a while, and who asked for them then would be refused. A
 *  reading that another one cut short would go on with what was known before. */
class Refresher {
  private readonly wishes: { planes: boolean }[] = [];
  private busy = false;
  private readonly client: QueryClient;
  private readonly id: string;

  constructor(client: QueryClient, id: string) {
    this.client = client;
    this.id = id;
  }

  ask(planes: boolean): void {
    this.wishes.push({ planes });
    if (!this.busy) void this.serve();
  }

  private async serve(): Promise<void> {
    this.busy = true;
    let planes = false;
    while (this.wishes.length > 0) {
      const asked = this.wishes.splice(0);
      planes ||= asked.some((wish) => wish.planes);
      await readAnew(this.client, { queryKey: keys.recording(this.id), exact: true });
    }
    this.busy = false;
    if (planes) this.readPlanes();
  }

  private readPlanes(): void {
    const there = this.client.getQueryData<Recording>(keys.recording(this.id))?.has_planes === true;
    void this.client.invalidateQueries({ queryKey: keys.planes(this.id), refetchType: there ? "active" : "none" });
  }
}

/** All that is known of a recording, its planes once it is known whether there are any. */
function readAll(client: QueryClient, id: string, refresher: Refresher): void {
  refresher.ask(true);
  void client.invalidateQueries({
    queryKey: keys.recording(id),
    predicate: ({ queryKey }) => queryKey.length > 2 && queryKey[2] !== keys.planes(id)[2],
  });
}

/** Brings what is cached of a recording up to date with one message. */
function applyMessage(client: QueryClient, id: string, message: RecordingMessage, refresher: Refresher): void {
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
      noteJob(client, id, message.job);
      // A report names the planes and says which way is up.
      refresher.ask(message.job.kind === "planes" || message.job.kind === "inspect");
      return;
    case "recording-changed":
      if (message.deleted) client.removeQueries({ queryKey: keys.recording(id) });
      readAll(client, id, refresher);
      void client.invalidateQueries({ queryKey: keys.recordings });
      return;
    case "resync":
      readAll(client, id, refresher);
      void client.invalidateQueries({ predicate: ({ queryKey }) => queryKey[0] !== keys.recording(id)[0] });
      return;
  }
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
    const refresher = new Refresher(client, id);
    const source = new EventSource(`/api/recordings/${id}/events`);
    source.onmessage = (event: MessageEvent<string>) => {
      applyMessage(client, id, spoken(JSON.parse(event.data) as RecordingMessage), refresher);
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
      readAll(client, id, refresher);
    };
    return () => {
      if (broke !== null) window.clearTimeout(broke);
      source.close();
    };
  }, [client, id]);
  return lost;
}
