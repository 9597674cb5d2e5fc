import { useLocalStorage } from "@mantine/hooks";
import { useCallback } from "react";

/** What of a run can be looked at. */
export type Looked = "inspect" | "result";
export type Seen = ReadonlySet<string>;

export const lookOf = (what: Looked, jobId: string) => `${what} ${jobId}`;

/** More runs than anybody goes back to; the oldest are forgotten. */
const remembered = 400;

/** What this browser has looked at of each run, and what to call when it looks at something: nobody else knows of it. */
export function useSeen(): [Seen, (what: Looked, jobId: string) => void] {
  const [kept, setKept] = useLocalStorage<string[]>({
    key: "unsweep seen",
    defaultValue: [],
    getInitialValueInEffect: false,
  });
  const look = useCallback(
    (what: Looked, jobId: string) =>
      setKept((before) => {
        const known = listOf(before);
        const one = lookOf(what, jobId);
        return known.includes(one) ? before : [...known, one].slice(-remembered);
      }),
    [setKept],
  );
  return [new Set(listOf(kept)), look];
}

/** What somebody else left under that name is no list. */
function listOf(kept: unknown): string[] {
  return Array.isArray(kept) ? kept.filter((one): one is string => typeof one === "string") : [];
}
