import { useQueryClient } from "@tanstack/react-query";
import { createContext, useCallback, useContext, useMemo, useRef, useState, type ReactNode } from "react";
import type { HttpRequest, PreviousUpload, Upload as TusUpload } from "tus-js-client";
import { readAnew } from "../../api/anew";
import { asFault, type ApiFault } from "../../api/fault";
import { keys } from "../../api/queries";
import { addSample, type RateSample } from "./rate";

export interface UploadProgress {
  /** Null until the server has given it one. */
  recordingId: string | null;
  name: string;
  size: number;
  samples: readonly RateSample[];
  /** Whether it waits for this machine to be on a network again. */
  waiting: boolean;
  fault: ApiFault | null;
}

interface Uploads {
  list: readonly UploadProgress[];
  /** Resolves with the recording's id as soon as the server has made room for it; the bytes follow. */
  start: (file: File) => Promise<string>;
  cancel: (recordingId: string) => void;
}

/** What is lost of a broken connection at most, and what the browser keeps in memory to hash. */
const chunkBytes = 8 * 1024 * 1024;
/** Refusals that are no fault of the file: somebody else writes, the offset has moved, bytes changed on the way. */
const passingStatuses = [409, 423, 460];
const UploadContext = createContext<Uploads | null>(null);

export function useUploads(): Uploads {
  const uploads = useContext(UploadContext);
  if (uploads === null) throw new Error("useUploads needs an UploadProvider above it");
  return uploads;
}

/** What the page holds of an upload under way: the upload, and how to have it wait for no network any more. */
interface Running {
  upload: TusUpload;
  dropped: AbortController;
}

/** Uploads go on whatever screen is shown, and resume by themselves after a lost connection or a restarted server. */
export function UploadProvider({ children }: { children: ReactNode }) {
  const client = useQueryClient();
  const running = useRef(new Map<string, Running>());
  const [list, setList] = useState<readonly UploadProgress[]>([]);

  const start = useCallback(
    async (file: File) => {
      const { Upload } = await import("tus-js-client");
      const token = Symbol(file.name);
      const dropped = new AbortController();
      const entries = new Map<symbol, UploadProgress>();
      const show = (change: Partial<UploadProgress>) => {
        const before = entries.get(token) ?? {
          recordingId: null,
          name: file.name,
          size: file.size,
          samples: [],
          waiting: false,
          fault: null,
        };
        const after = { ...before, ...change };
        entries.set(token, after);
        setList((old) => [...old.filter((one) => one !== before), after]);
        return after;
      };
      const hide = () => setList((old) => old.filter((one) => one !== entries.get(token)));

      return new Promise<string>((resolve, reject) => {
        const upload = new Upload(file, {
          endpoint: "/api/uploads",
          chunkSize: chunkBytes,
          retryDelays: [0, 1000, 2000, 4000, 8000, 15000, 30000],
          metadata: { filename: file.name, filetype: file.type === "" ? "application/octet-stream" : file.type },
          removeFingerprintOnSuccess: true,
          onBeforeRequest: (request) => addChecksum(request, file),
          onShouldRetry: (error) => {
            const status = error.originalResponse?.getStatus() ?? 0;
            // Without a network every try is in vain, and they are soon used up: onError waits for one.
            return navigator.onLine && (status < 400 || status >= 500 || passingStatuses.includes(status));
          },
          onUploadUrlAvailable: () => {
            const id = upload.url?.replace(/\/+$/, "").split("/").at(-1) ?? "";
            running.current.set(id, { upload, dropped });
            show({ recordingId: id });
            resolve(id);
          },
          onProgress: (sent) => {
            const samples = entries.get(token)?.samples ?? [];
            show({ samples: addSample(samples, { atMs: performance.now(), bytes: sent }) });
          },
          onSuccess: () => {
            hide();
            const id = entries.get(token)?.recordingId;
            if (id !== null && id !== undefined) {
              running.current.delete(id);
              void readAnew(client, { queryKey: keys.recording(id) });
            }
            void client.invalidateQueries({ queryKey: keys.recordings });
          },
          onError: (error) => {
            if (!navigator.onLine) {
              // The speed of before says nothing of the one to come.
              show({ waiting: true, samples: (entries.get(token)?.samples ?? []).slice(-1) });
              const goOn = () => {
                show({ waiting: false });
                upload.start(); // asks the server how much it has, and goes on from there
              };
              window.addEventListener("online", goOn, { once: true, signal: dropped.signal });
              return;
            }
            const fault = asFault(uploadError(error));
            show({ fault });
            reject(fault);
          },
        });
        show({});
        // What was begun before is looked up where browsers keep it; one that forbids that begins anew.
        void previousOf(upload).then((last) => {
          if (last !== undefined) upload.resumeFromPreviousUpload(last);
          upload.start();
        });
      });
    },
    [client],
  );

  const cancel = useCallback(
    (recordingId: string) => {
      const stopped = running.current.get(recordingId);
      stopped?.dropped.abort();
      void stopped?.upload.abort(true);
      running.current.delete(recordingId);
      setList((old) => old.filter((one) => one.recordingId !== recordingId));
      void client.invalidateQueries({ queryKey: keys.recordings });
    },
    [client],
  );

  const uploads = useMemo<Uploads>(() => ({ list, start, cancel }), [list, start, cancel]);
  return <UploadContext value={uploads}>{children}</UploadContext>;
}

/** The interrupted upload of the same file; undefined where there is none, or where it cannot be looked up. */
export async function previousOf(upload: Pick<TusUpload, "findPreviousUploads">): Promise<PreviousUpload | undefined> {
  try {
    return (await upload.findPreviousUploads())[0];
  } catch {
    return undefined;
  }
}

/** What the bytes of a request hash to, so that the server keeps them only as they are here. */
async function addChecksum(request: HttpRequest, file: File): Promise<void> {
  const offset = request.getHeader("Upload-Offset");
  // Browsers hash for pages that came over https or from this machine only.
  if (request.getMethod() !== "PATCH" || offset === undefined || !window.isSecureContext) return;
  const bytes = await file.slice(Number(offset), Number(offset) + chunkBytes).arrayBuffer();
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
  request.setHeader("Upload-Checksum", `sha256 ${btoa(String.fromCharCode(...digest))}`);
}

/** The server's own sentence, where the failed request carries one. */
function uploadError(error: Error): Error {
  if (!("originalResponse" in error)) return error;
  const response = error.originalResponse as { getBody: () => string } | null;
  try {
    const told = JSON.parse(response?.getBody() ?? "") as { error?: { text?: string } };
    return new Error(told.error?.text ?? error.message);
  } catch {
    return new Error(
      "The upload was interrupted and could not be resumed; see that the server runs, then drop the file again to go on.",
    );
  }
}
