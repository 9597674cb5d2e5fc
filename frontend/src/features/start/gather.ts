import { tarOf } from "./tar";

/** A file and the folder it lies in, as a path below what was dropped; "" for a file dropped by itself. */
export interface FoundFile {
  folder: string;
  file: File;
}

const storage = /\.(bag|mcap|db3)(\.(zstd?|active))?$/i;
const archive = /\.(zip|tar|tgz|tar\.(gz|bz2|xz))$/i;
const split = /^(.*?)_\d+\.(bag|mcap|db3)(\.(zstd?|active))?$/i;

/** Everything below what was dropped. Must be called while the drop event is handled: its items do not outlive it. */
export async function filesOfDrop(transfer: DataTransfer): Promise<FoundFile[]> {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
  if (entries.length === 0) return [...transfer.files].map((file) => ({ folder: "", file }));
  return (await Promise.all(entries.map((entry) => filesBelow(entry, "")))).flat();
}

/** The same for a folder chosen in a dialog. */
export function filesOfFolder(files: Iterable<File>): FoundFile[] {
  return [...files].map((file) => ({ folder: file.webkitRelativePath.split("/").slice(0, -1).join("/"), file }));
}

async function filesBelow(entry: FileSystemEntry, folder: string): Promise<FoundFile[]> {
  if (entry.isFile) {
    const file = await new Promise<File>((resolve, reject) => (entry as FileSystemFileEntry).file(resolve, reject));
    return [{ folder, file }];
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const below = folder === "" ? entry.name : `${folder}/${entry.name}`;
  const found: FoundFile[] = [];
  for (;;) {
    // A hundred at a time, by the standard, until none are left.
    const some = await new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return found;
    found.push(...(await Promise.all(some.map((child) => filesBelow(child, below)))).flat());
  }
}

/** The one file to send for what was dropped. Throws one sentence where that is not one recording. */
export function recordingOf(found: readonly FoundFile[]): File {
  const parts = found.filter(({ file }) => storage.test(file.name));
  const only = found[0];
  if (parts.length === 0) {
    // A single file is sent as it is: the server says best what is wrong with it.
    const packed = found.filter(({ file }) => archive.test(file.name));
    const single = packed[0] ?? only;
    if (single !== undefined && (found.length === 1 || packed.length === 1)) return single.file;
    const where = only === undefined || only.folder === "" ? "What was dropped" : `The folder ${top(only.folder)}`;
    throw new Error(`${where} holds no .bag, .mcap or .db3 file; drop a bag, or the bag's own folder.`);
  }
  const folders = [...new Set(parts.map(({ folder }) => folder))];
  if (folders.length > 1) {
    throw new Error(`These are ${folders.length} recordings (${named(folders)}); drop one of them at a time.`);
  }
  const first = parts[0];
  if (first === undefined) throw new Error("Nothing was dropped; try again.");
  if (parts.length === 1) return first.file;
  const stems = new Set(parts.map(({ file }) => split.exec(file.name)?.[1] ?? file.name));
  const described = found.some(({ folder, file }) => folder === first.folder && file.name === "metadata.yaml");
  if (stems.size > 1 && !described) {
    throw new Error(`These are ${stems.size} recordings (${named([...stems])}); drop one of them at a time.`);
  }
  const name = first.folder === "" ? ([...stems][0] ?? "recording") : top(first.folder, true);
  // The list first: it says which pieces there are, and whether some are missing.
  const listed = found.filter(({ folder, file }) => folder === first.folder && file.name === "metadata.yaml");
  return tarOf(
    `${name}.tar`,
    [...listed, ...parts].map(({ file }) => ({ name: file.name, file })),
  );
}

function top(folder: string, last = false): string {
  return folder.split("/").at(last ? -1 : 0) ?? folder;
}

function named(names: readonly string[]): string {
  const most = 3;
  return names.slice(0, most).join(", ") + (names.length > most ? ", …" : "");
}
