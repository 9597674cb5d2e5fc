import { useQueryClient } from "@tanstack/react-query";
import { useCallback, useEffect, useState } from "react";
import type { View } from "../../api/client";
import { keys } from "../../api/queries";
import type { StepName } from "../../ui/stepper";

/** How often this tab was come back to while the scene showed the screen of another one, and what to call where that is seen
 *  elsewhere. Who looks at a screen is to see its scene: the screen tells it anew each time. */
export function useReturns(recordingId: string, mode: StepName | null): [number, () => void] {
  const client = useQueryClient();
  const [returns, setReturns] = useState(0);
  const back = useCallback(() => {
    const shown = client.getQueryData<View>(keys.view(recordingId))?.mode;
    const astray = mode !== null && shown !== undefined && shown !== mode;
    if (astray && document.visibilityState === "visible") setReturns((before) => before + 1);
  }, [client, recordingId, mode]);
  useEffect(() => {
    window.addEventListener("focus", back);
    document.addEventListener("visibilitychange", back);
    return () => {
      window.removeEventListener("focus", back);
      document.removeEventListener("visibilitychange", back);
    };
  }, [back]);
  return [returns, back];
}
