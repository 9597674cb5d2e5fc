import { useComputedColorScheme } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useRef, useState, type RefObject } from "react";
import { useChangeView } from "../../api/changes";
import { askUnder, viewQuery } from "../../api/queries";
import { tab } from "../../api/tab";
import { Notice } from "../../ui/notice";
import { useShortcutRegistry } from "../../ui/shortcuts";
import type { StepName } from "../../ui/stepper";
import css from "./layout.module.css";
import { SceneTools } from "./scenetools";

/** The 3D canvas. It stays mounted while the recording is open, since connecting it takes seconds. */
export function ScenePane({
  recordingId,
  visible,
  mode,
  onEntered,
}: {
  recordingId: string;
  visible: boolean;
  mode: StepName | null;
  /** The canvas is about to be used: its window takes the focus, and the page around it hears nothing of that. */
  onEntered: () => void;
}) {
  const frame = useRef<HTMLIFrameElement>(null);
  const [loaded, setLoaded] = useState(false);
  const [wanted, setWanted] = useState(visible);
  if (visible && !wanted) setWanted(true);
  const view = useQuery({ ...viewQuery(recordingId), enabled: wanted });
  useSceneScheme(recordingId, wanted);
  const drawn = useFirstPicture(frame, loaded);

  // Keys pressed while the canvas has the focus belong to the screen around it.
  const { handle } = useShortcutRegistry();
  useEffect(() => {
    const inner = loaded ? frame.current?.contentWindow : null;
    inner?.addEventListener("keydown", handle);
    return () => inner?.removeEventListener("keydown", handle);
  }, [handle, loaded]);

  useEffect(() => {
    const inner = loaded ? frame.current?.contentWindow : null;
    inner?.addEventListener("focus", onEntered);
    return () => inner?.removeEventListener("focus", onEntered);
  }, [onEntered, loaded]);

  const under = useUnderPointer(recordingId, frame, visible && drawn);

  if (!wanted) return null;
  const shown = view.data;
  return (
    <section className={css.scene} data-visible={visible} aria-label="3D scene" aria-hidden={!visible}>
      <iframe
        ref={frame}
        src={`/scene/${recordingId}/${tab}/`}
        title="3D scene: drag to orbit, scroll to zoom, click a plane"
        tabIndex={visible ? 0 : -1}
        onLoad={() => setLoaded(true)}
      />
      <div className={css.waiting} data-gone={drawn}>
        Opening the 3D scene…
      </div>
      {under !== null && (
        <div className={css.under} aria-hidden="true" style={{ left: `${under.u * 100}%`, top: `${under.v * 100}%` }}>
          <span data-flipped={under.u > 0.6}>{under.text}</span>
        </div>
      )}
      {visible && shown !== undefined && shown.note !== "" && shown.mode === mode && (
        <div className={css.note}>
          <Notice level="info">{shown.note}</Notice>
        </div>
      )}
      {visible && drawn && shown !== undefined && <SceneTools recordingId={recordingId} view={shown} />}
      {visible && shown !== undefined && shown.legend !== "" && shown.mode === mode && (
        <div className={css.caption}>{shown.legend}</div>
      )}
    </section>
  );
}

const lookEveryMs = 100;
/** What the scene's own, unseen panel is called once background and first points have been sent; they are drawn soon after. */
const firstPicture = "first picture";
const panels = "[data-testid^='floating-panel'], .mantine-Paper-root[style*='position: fixed']";
const firstPictureMs = 600;
/** A browser that cannot draw shows what it has to say after this. */
const longestMs = 20_000;

/** Whether the scene has its first picture: until then its own page is white, and would flash. */
function useFirstPicture(frame: RefObject<HTMLIFrameElement | null>, loaded: boolean): boolean {
  const [drawn, setDrawn] = useState(false);
  useEffect(() => {
    if (!loaded || drawn) return;
    let waited = 0;
    let seen = 0;
    const timer = window.setInterval(() => {
      waited += lookEveryMs;
      const panel = frame.current?.contentDocument?.querySelector(panels);
      if (panel?.textContent.includes(firstPicture) === true) seen += lookEveryMs;
      if (seen >= firstPictureMs || waited >= longestMs) setDrawn(true);
    }, lookEveryMs);
    return () => window.clearInterval(timer);
  }, [frame, loaded, drawn]);
  return drawn;
}

interface Under {
  u: number;
  v: number;
  text: string;
}

/** A pointer that rests so long is asked about; one that moves on is not. */
const restMs = 140;

/** What is under the pointer that rests on the canvas; null while it moves, drags or is elsewhere. */
function useUnderPointer(id: string, frame: RefObject<HTMLIFrameElement | null>, asked: boolean): Under | null {
  const [under, setUnder] = useState<Under | null>(null);
  useEffect(() => {
    const inner = asked ? frame.current?.contentWindow : null;
    if (inner === null || inner === undefined) return;
    let timer = 0;
    let place = 0;
    const forget = () => {
      window.clearTimeout(timer);
      place += 1;
      setUnder(null);
    };
    const moved = (event: PointerEvent) => {
      forget();
      if (event.buttons !== 0 || event.pointerType === "touch") return;
      const [u, v] = [event.clientX / inner.innerWidth, event.clientY / inner.innerHeight];
      const mine = place;
      timer = window.setTimeout(() => {
        void askUnder(id, u, v).then((text) => {
          if (mine === place && text !== "") setUnder({ u, v, text });
        });
      }, restMs);
    };
    const leaves = ["pointerdown", "wheel", "blur"] as const;
    inner.addEventListener("pointermove", moved);
    inner.document.documentElement.addEventListener("pointerleave", forget);
    for (const name of leaves) inner.addEventListener(name, forget);
    return () => {
      forget();
      inner.removeEventListener("pointermove", moved);
      inner.document.documentElement.removeEventListener("pointerleave", forget);
      for (const name of leaves) inner.removeEventListener(name, forget);
    };
  }, [id, frame, asked]);
  return under;
}

/** Tells the scene which background to draw on, when it opens and when the page's scheme changes. */
function useSceneScheme(recordingId: string, wanted: boolean) {
  const dark = useComputedColorScheme("dark") === "dark";
  const { mutate } = useChangeView(recordingId);
  useEffect(() => {
    if (wanted) mutate({ dark });
  }, [dark, wanted, mutate]);
}
