import { useEffect, useState } from "react";

/** Lets a file be dropped anywhere on the page. Returns whether one hovers over it now.
 *
 *  Both callbacks must keep their identity. A folder cannot be sent as one file: its name is handed on instead.
 */
export function usePageDrop(onFile: (file: File) => void, onFolder: (name: string) => void): boolean {
  const [dragging, setDragging] = useState(false);
  useEffect(() => {
    let depth = 0;
    const carriesFiles = (event: DragEvent) => event.dataTransfer?.types.includes("Files") === true;
    const enter = (event: DragEvent) => {
      if (!carriesFiles(event)) return;
      depth += 1;
      setDragging(true);
    };
    const leave = () => {
      depth = Math.max(0, depth - 1);
      if (depth === 0) setDragging(false);
    };
    const over = (event: DragEvent) => {
      if (carriesFiles(event)) event.preventDefault();
    };
    const drop = (event: DragEvent) => {
      if (!carriesFiles(event)) return;
      event.preventDefault();
      depth = 0;
      setDragging(false);
      const entry = event.dataTransfer?.items[0]?.webkitGetAsEntry();
      const file = event.dataTransfer?.files[0];
      if (entry?.isDirectory === true) onFolder(entry.name);
      else if (file !== undefined) onFile(file);
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
  }, [onFile, onFolder]);
  return dragging;
}
