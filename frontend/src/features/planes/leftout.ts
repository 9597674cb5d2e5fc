import type { CalibrationResult, Patch, Run } from "../../api/client";
import { blamed, doubted, leftOut } from "../../api/sentences";

/** The newest run with a result that planes were given to, and its number as the list of runs counts. */
export function lastSolve(runs: readonly Run[]): { run: Run; number: number } | null {
  const at = runs.findIndex((run) => run.job.result?.kind === "solve" && (run.job.planes ?? []).length > 0);
  const run = runs[at];
  return run === undefined ? null : { run, number: runs.length - at };
}

/** What a refusal says of one plane; undefined where it does not name it. */
function blameOn(name: string, messages: CalibrationResult["messages"]): string | undefined {
  return messages
    .filter(({ code, level }) => code.startsWith("planes.") && level === "error")
    .flatMap(({ text }) => blamed.exec(text)?.[1]?.split(", ") ?? [])
    .find((part) => part.startsWith(`${name} `))
    ?.slice(name.length + 1)
    .replace(/^is /, "");
}

/** Why nothing is foreseen of a solve with these planes: one of them counts though it seems to be none, or a run has found that it
 *  is none. Empty where all that count seem sound.
 */
export function cautionOf(patches: readonly Patch[], remarks: ReadonlyMap<number, string> | undefined): string {
  const culprits = patches.filter(
    ({ index, confirmed, insisted, doubt }) => confirmed && insisted && (doubt !== "" || remarks?.has(index) === true),
  );
  if (culprits.length === 0) return "";
  const names = culprits.map(({ name }) => name).join(", ");
  return `No forecast for this choice: ${names} ${culprits.length === 1 ? "is" : "are"} used though doubtful.`;
}

/** What seems wrong with a plane before a solve, as a remark on it. */
export function doubtOf({ doubt, insisted, confirmed }: Patch): string | undefined {
  if (doubt === "") return undefined;
  return insisted || !confirmed ? doubt : `${doubt}: likely to be left out`;
}

/** What the last solve left out, doubted, or was refused for, as a remark on each patch, by its index: "left out by run 2: not flat".
 *
 *  A plane is known by its colour and by what it is called today: one that was grown since is none of the run's. Only a remark:
 *  who knows the place may keep it.
 */
export function remarksOf(
  patches: readonly Patch[],
  run: Run,
  number: number,
  result: Pick<CalibrationResult, "messages" | "quality">,
): Map<number, string> {
  const used = new Set(result.quality.planes.map((plane) => plane.name));
  const remarks = new Map<number, string>();
  for (const patch of patches) {
    const look = run.job.planes?.find((plane) => plane.title === patch.name && plane.color === patch.color);
    if (look === undefined) continue;
    const told = (pattern: RegExp) =>
      result.messages
        .filter(({ code, text }) => code.startsWith("planes.") && text.startsWith(`${look.name} `))
        .map(({ text }) => pattern.exec(text.slice(look.name.length + 1))?.[1])
        .find((words) => words !== undefined);
    if (used.has(look.name)) {
      const doubt = told(doubted);
      if (doubt !== undefined) remarks.set(patch.index, `doubtful in run ${number}: ${doubt}`);
      continue;
    }
    const why = told(leftOut);
    const blame = blameOn(look.name, result.messages);
    if (why !== undefined) remarks.set(patch.index, `left out by run ${number}: ${why}`);
    else if (blame !== undefined) remarks.set(patch.index, `run ${number} was refused for it: ${blame}`);
    // A run that was refused on the way may list no planes at all: that says nothing of any of them.
    else if (used.size > 0) remarks.set(patch.index, `left out by run ${number}`);
  }
  return remarks;
}
