import { Button, Modal, Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import type { FolderEntry } from "../../api/client";
import { useOpenRecording } from "../../api/changes";
import { folderQuery } from "../../api/queries";
import { bytes } from "../../ui/format";
import { Icon, type IconName } from "../../ui/icons";
import { Fault, StateBox } from "../../ui/notice";
import css from "./start.module.css";

const icons: Record<FolderEntry["kind"], IconName> = { folder: "folder", recording: "sample", file: "file" };

/** The server's own recordings, opened in place and without a copy. */
export function FolderDialog({ onClose, onOpened }: { onClose: () => void; onOpened: (id: string) => void }) {
  const [path, setPath] = useState("");
  const listing = useQuery(folderQuery(path));
  const open = useOpenRecording();
  const pick = (entry: FolderEntry) => {
    if (entry.kind === "folder") setPath(entry.path);
    else open.mutate({ folder_path: entry.path }, { onSuccess: (made) => onOpened(made.id) });
  };
  return (
    <Modal
      opened
      onClose={onClose}
      size={560}
      title="Recordings on the server"
      closeButtonProps={{ "aria-label": "Close" }}
    >
      <div
        className="dim small"
        style={{ display: "flex", alignItems: "center", gap: 8, minHeight: 30, marginBottom: 6 }}
      >
        <Button
          size="compact-sm"
          variant="default"
          disabled={listing.data?.parent === null || listing.data === undefined}
          onClick={() => setPath(listing.data?.parent ?? "")}
        >
          Up
        </Button>
        <span className="num clip">/{path}</span>
      </div>
      <ul className={css.folder}>
        {listing.isPending && [0, 1, 2, 3].map((i) => <Skeleton key={i} height={28} mb={8} />)}
        {listing.isError && <Fault error={listing.error} onRetry={() => void listing.refetch()} />}
        {listing.data?.entries.length === 0 && listing.data.links_out === 0 && (
          <StateBox title="This folder is empty" />
        )}
        {listing.data?.entries.map((entry) => (
          <li key={entry.path}>
            <button type="button" disabled={entry.kind === "file" || open.isPending} onClick={() => pick(entry)}>
              <Icon name={icons[entry.kind]} />
              <span className="clip">{entry.name}</span>
              {entry.kind !== "folder" && <span className="num dim">{bytes(entry.size_bytes)}</span>}
            </button>
          </li>
        ))}
      </ul>
      {listing.data !== undefined && listing.data.links_out > 0 && (
        <p className="dim small">
          {listing.data.links_out === 1 ? "1 link leads" : `${listing.data.links_out} links lead`} out of this folder
          and {listing.data.links_out === 1 ? "is" : "are"} not followed: the server opens only what lies inside it.
          Start it with the folder that holds the recordings, or upload them.
        </p>
      )}
      {open.isError && <Fault error={open.error} />}
    </Modal>
  );
}
