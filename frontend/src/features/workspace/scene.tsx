import { useComputedColorScheme } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useRef, useState } from "react";
import { useChangeView, viewQuery } from "../../api/queries";
import { Notice } from "../../ui/notice";
import { useShortcutRegistry } from "../../ui/shortcuts";
import type { StepName } from "../../ui/stepper";
import css from "./layout.module.css";

/** The 3D canvas. It stays mounted while the recording is open, since connecting it takes seconds. */
export function ScenePane({ recordingId, visible, mode }: { recordingId: string; visible: boolean; mode: StepName | null }) {
  const frame = useRef<HTMLIFrameElement>(null);
  const [loaded, setLoaded] = useState(false);
  const [wanted, setWanted] = useState(visible);
  if (visible && !wanted) setWanted(true);
  const view = useQuery({ ...viewQuery(recordingId), enabled: wanted });
  useSceneScheme(recordingId, wanted);

  // Keys pressed while the canvas has the focus belong to the screen around it.
  const { handle } = useShortcutRegistry();
  useEffect(() => {
    const inner = loaded ? frame.current?.contentWindow : null;
    inner?.addEventListener("keydown", handle);
    return () => inner?.removeEventListener("keydown", handle);
  }, [handle, loaded]);

  if (!wanted) return null;
  const shown = view.data;
  return (
    <section className={css.scene} data-visible={visible} aria-label="3D scene" aria-hidden={!visible}>
      <iframe
        ref={frame}
        src={`/scene/${recordingId}/`}
        title="3D scene: drag to orbit, scroll to zoom, click a plane"
        tabIndex={visible ? 0 : -1}
        onLoad={() => setLoaded(true)}
      />
      <div className={css.waiting} data-gone={loaded}>
        Opening the 3D scene…
      </div>
      {visible && shown !== undefined && shown.note !== "" && shown.mode === mode && (
        <div className={css.note}>
          <Notice level="info">{shown.note}</Notice>
        </div>
      )}
      {visible && shown !== undefined && shown.legend !== "" && shown.mode === mode && (
        <div className={css.caption}>{shown.legend}</div>
      )}
    </section>
  );
}

/** Tells the scene which background to draw on, when it opens and when the page's scheme changes. */
function useSceneScheme(recordingId: string, wanted: boolean) {
  const dark = useComputedColorScheme("dark") === "dark";
  const { mutate } = useChangeView(recordingId);
  useEffect(() => {
    if (wanted) mutate({ dark });
  }, [dark, wanted, mutate]);
}
