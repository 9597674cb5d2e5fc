import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { createContext, useCallback, useContext, useEffect, useMemo, useRef, useState, type ReactNode } from "react";
import { useNavigate } from "react-router";
import { factsQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import { filesOfDrop, filesOfFolder, recordingOf, type FoundFile } from "./gather";
import css from "./start.module.css";
import { useUploads } from "./uploads";

interface DropZoneState {
  /** Whether something hovers over the page now. */
  dragging: boolean;
  chooseFile: () => void;
  chooseFolder: () => void;
}

const DropContext = createContext<DropZoneState | null>(null);

export function useDropZone(): DropZoneState {
  const state = useContext(DropContext);
  if (state === null) throw new Error("useDropZone needs a DropZone above it");
  return state;
}

/** Takes a recording dropped anywhere on any screen, or chosen in a dialog, and goes to it. */
export function DropZone({ children }: { children: ReactNode }) {
  const navigate = useNavigate();
  const facts = useQuery(factsQuery);
  const { start } = useUploads();
  const [error, setError] = useState<unknown>(null);
  const file = useRef<HTMLInputElement>(null);
  const folder = useRef<HTMLInputElement>(null);

  const upload = useCallback(
    (found: readonly FoundFile[]) => {
      setError(null);
      try {
        start(recordingOf(found)).then((id) => void navigate(`/r/${id}/recording`), setError);
      } catch (refusal) {
        setError(refusal);
      }
    },
    [start, navigate],
  );
  const drop = useCallback((transfer: DataTransfer) => void filesOfDrop(transfer).then(upload, setError), [upload]);
  const dragging = usePageDrop(drop);
  const state = useMemo<DropZoneState>(
    () => ({ dragging, chooseFile: () => file.current?.click(), chooseFolder: () => folder.current?.click() }),
    [dragging],
  );
  return (
    <DropContext value={state}>
      {children}
      <input
        ref={file}
        type="file"
        hidden
        multiple
        data-testid="file-input"
        accept={[...(facts.data?.upload_suffixes ?? []), ".zst", ".zstd", ".active"].join(",")}
        onChange={(event) => {
          const files = [...(event.currentTarget.files ?? [])];
          event.currentTarget.value = "";
          if (files.length > 0) upload(files.map((one) => ({ folder: "", file: one })));
        }}
      />
      <input
        ref={folder}
        type="file"
        hidden
        webkitdirectory=""
        data-testid="folder-input"
        onChange={(event) => {
          const files = [...(event.currentTarget.files ?? [])];
          event.currentTarget.value = "";
          upload(filesOfFolder(files));
        }}
      />
      {error !== null && (
        <div className={css.refusal}>
          <Fault error={error} />
          <Button size="compact-sm" variant="default" onClick={() => setError(null)}>
            Close
          </Button>
        </div>
      )}
      {dragging && (
        <div className={css.veil}>
          <div>
            <Icon name="upload" size={28} />
            <strong>Let go to open it</strong>
            <span>A bag, a bag&apos;s folder, or a .zip of it</span>
          </div>
        </div>
      )}
    </DropContext>
  );
}

/** Lets something be dropped anywhere on the page. Returns whether it hovers now. The callback must keep its identity. */
function usePageDrop(onDrop: (transfer: DataTransfer) => void): boolean {
  const [dragging, setDragging] = useState(false);
  useEffect(() => {
    const carriesFiles = (event: DragEvent) => event.dataTransfer?.types.includes("Files") === true;
    const enter = (event: DragEvent) => {
      if (carriesFiles(event)) setDragging(true);
    };
    const leave = (event: DragEvent) => {
      // Only when the pointer leaves the window does it come from nowhere.
      if (event.relatedTarget === null) setDragging(false);
    };
    const over = (event: DragEvent) => {
      if (!carriesFiles(event)) return;
      event.preventDefault();
      setDragging(true);
    };
    const drop = (event: DragEvent) => {
      setDragging(false);
      if (!carriesFiles(event) || event.dataTransfer === null) return;
      event.preventDefault();
      onDrop(event.dataTransfer);
    };
    window.addEventListener("dragenter", enter);
    window.addEventListener("dragleave", leave);
    window.addEventListener("dragover", over);
    window.addEventListener("drop", drop);
    return () => {
      window.removeEventListener("dragenter", enter);
      window.removeEventListener("dragleave", leave);
      window.removeEventListener("dragover", over);
      window.removeEventListener("drop", drop);
    };
  }, [onDrop]);
  return dragging;
}
