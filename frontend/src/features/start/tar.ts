/** A tar archive made of what is already on disk: the browser reads each file only when its bytes are sent. */

export interface TarEntry {
  /** A bare file name: the reader takes no folders. */
  name: string;
  file: File;
}

const blockBytes = 512;
/** Eleven octal digits; larger files write their size in binary, which every tar of this century reads. */
const mostOctal = 8 ** 11 - 1;

export function tarOf(archiveName: string, entries: readonly TarEntry[]): File {
  const parts: BlobPart[] = [];
  for (const { name, file } of entries) {
    parts.push(header(name, file.size, file.lastModified), file);
    const rest = file.size % blockBytes;
    if (rest > 0) parts.push(new Uint8Array(blockBytes - rest));
  }
  parts.push(new Uint8Array(2 * blockBytes));
  // The same files give the same name, size and time: an interrupted upload is found again by them.
  const lastModified = Math.max(0, ...entries.map(({ file }) => file.lastModified));
  return new File(parts, archiveName, { type: "application/x-tar", lastModified });
}

function header(name: string, size: number, modifiedMs: number): Uint8Array<ArrayBuffer> {
  const block = new Uint8Array(blockBytes);
  const text = (at: number, value: string) => block.set(new TextEncoder().encode(value), at);
  text(0, shortened(name));
  text(100, "0000644\0");
  text(108, "0000000\0");
  text(116, "0000000\0");
  if (size <= mostOctal) text(124, `${size.toString(8).padStart(11, "0")}\0`);
  else block.set(binarySize(size), 124);
  text(
    136,
    `${Math.floor(modifiedMs / 1000)
      .toString(8)
      .padStart(11, "0")}\0`,
  );
  text(148, " ".repeat(8));
  text(156, "0");
  text(257, "ustar\0");
  text(263, "00");
  const sum = block.reduce((all, byte) => all + byte, 0);
  text(148, `${sum.toString(8).padStart(6, "0")}\0 `);
  return block;
}

function binarySize(size: number): Uint8Array<ArrayBuffer> {
  const field = new Uint8Array(12);
  let left = size;
  for (let i = 11; i > 0; i -= 1) {
    field[i] = left % 256;
    left = Math.floor(left / 256);
  }
  field[0] = 0x80;
  return field;
}

/** At most 99 bytes, the ending kept: the reader goes by it. */
function shortened(name: string): string {
  const fits = (text: string) => new TextEncoder().encode(text).length <= 99;
  if (fits(name)) return name;
  const ending = /(\.[a-z0-9]+){1,2}$/i.exec(name)?.[0] ?? "";
  let stem = name.slice(0, name.length - ending.length);
  while (!fits(stem + ending)) stem = stem.slice(0, -1);
  return stem + ending;
}
