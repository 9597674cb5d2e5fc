import { ActionIcon, SegmentedControl } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import type { Planes, View } from "../../api/client";
import { useChangeView } from "../../api/changes";
import { viewQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { useShortcuts } from "../../ui/shortcuts";
import css from "./planes.module.css";

type Click = View["click"];

const hints: Record<Click, string> = {
  toggle: "Click a coloured patch. Drag turns the view.",
  grow: "Click the cloud where it is flat: a plane grows from that point.",
  restrict:
    "Drag a box: what lies outside makes no plane and is not used by the solve. Click a plane first to cut only that one.",
};

function isClick(value: string): value is Click {
  return value in hints;
}

/** What the mouse does in the scene: judge a patch, grow a new one from a point of the cloud, or draw a box. */
export function ClickMode({ recordingId, planes, onSet }: { recordingId: string; planes: Planes; onSet: () => void }) {
  const view = useQuery(viewQuery(recordingId));
  const change = useChangeView(recordingId);
  const click = view.data?.click ?? "toggle";
  const target = view.data?.target ?? null;
  const chosen = click === "restrict" ? planes.patches.find((patch) => patch.index === target) : undefined;
  const set = (wish: Click) => {
    onSet();
    change.mutate({ click: wish });
  };
  useShortcuts("3D scene", [
    { keys: "c", label: "Click confirms or drops", run: () => set("toggle") },
    { keys: "g", label: "Click grows a plane", run: () => set("grow") },
    { keys: "b", label: "Drag a box that restricts", run: () => set("restrict") },
    ...(click === "toggle" ? [] : [{ keys: "Escape", label: "Back to confirming", run: () => set("toggle") }]),
  ]);
  return (
    <div className={css.clickmode}>
      <SegmentedControl
        size="xs"
        aria-label="What the mouse does in the scene"
        value={click}
        onChange={(value) => {
          if (isClick(value)) set(value);
        }}
        data={[
          { value: "toggle", label: "Confirm or drop" },
          { value: "grow", label: "Grow" },
          { value: "restrict", label: "Restrict" },
        ]}
      />
      {chosen === undefined ? (
        <span className={css.hint}>{hints[click]}</span>
      ) : (
        <span className={css.hint}>
          <span className={css.swatch} style={{ background: chosen.color }} />
          Drag a box around the part of <strong>{chosen.name}</strong> to keep
          <ActionIcon
            size="xs"
            variant="subtle"
            color="gray"
            aria-label="Cut all planes instead"
            onClick={() => change.mutate({ target: null })}
          >
            <Icon name="cross" size={11} />
          </ActionIcon>
        </span>
      )}
    </div>
  );
}
