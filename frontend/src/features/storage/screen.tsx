import { Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { bytes } from "../../ui/format";
import { Fault, StateBox } from "../../ui/notice";
import { Shell } from "../../ui/shell";
import { stepsOf } from "../workspace/state";
import { storageQuery, type StorageUse } from "./queries";
import { RecordingUseRow } from "./row";
import css from "./storage.module.css";

/** What takes room on the server's disk, the largest first, and links that show one recording to others. */
export function StorageScreen() {
  const storage = useQuery(storageQuery);
  return (
    <Shell steps={stepsOf(undefined, undefined, [], "")} current={null}>
      <main className={css.storage}>
        <h1>Storage</h1>
        {storage.isPending ? (
          <Skeleton height={200} />
        ) : storage.isError ? (
          <Fault error={storage.error} onRetry={() => void storage.refetch()} />
        ) : (
          <Used use={storage.data} />
        )}
      </main>
    </Shell>
  );
}

function Used({ use }: { use: StorageUse }) {
  return (
    <>
      <p>{sentenceOf(use)}</p>
      {use.recordings.length === 0 ? (
        <StateBox title="Nothing here yet">
          <p>What you open takes room here until you remove it.</p>
        </StateBox>
      ) : (
        <table className={css.table}>
          <thead>
            <tr>
              <th scope="col">Recording</th>
              <th scope="col">File</th>
              <th scope="col">Read from it</th>
              <th scope="col">Results</th>
              <th scope="col">Last used</th>
              <th scope="col">
                <span className="sr-only">Actions</span>
              </th>
            </tr>
          </thead>
          <tbody>
            {use.recordings.map((one) => (
              <RecordingUseRow key={one.recording_id} use={one} />
            ))}
          </tbody>
        </table>
      )}
    </>
  );
}

/** The disk, the quota and how long things stay, in one or two sentences. */
export function sentenceOf(use: StorageUse): string {
  const left = Math.max(0, use.disk_free_bytes - use.kept_free_bytes);
  const room = use.quota_bytes === null ? left : Math.min(left, Math.max(0, use.quota_bytes - use.used_bytes));
  const stays =
    use.keep_days === null
      ? "Everything stays until somebody removes it."
      : `What nobody has used for ${use.keep_days} ${use.keep_days === 1 ? "day" : "days"} is removed.`;
  const taken = use.quota_bytes === null ? "" : ` of the ${bytes(use.quota_bytes)} allowed`;
  // The disk holds other things, too: its size is no measure of what is left.
  return `Recordings and results take ${bytes(use.used_bytes)}${taken}; there is room for ${bytes(room)} more. ${stays}`;
}
