import { useOutletContext } from "react-router";
import type { Job, Planes, Recording, Run } from "../../api/client";

/** What every screen of a recording is given by the layout around it. */
export interface Workspace {
  recording: Recording;
  /** Undefined until planes have been proposed. */
  planes: Planes | undefined;
  /** All jobs, newest first; undefined while they are fetched. */
  jobs: readonly Job[] | undefined;
  runs: readonly Run[];
  /** How often this tab was come back to while the scene showed another one's screen. */
  returns: number;
}

export function useWorkspace(): Workspace {
  return useOutletContext<Workspace>();
}
