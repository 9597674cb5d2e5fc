import { SegmentedControl } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useChangeView, viewQuery } from "../../api/queries";
import { useShortcuts } from "../../ui/shortcuts";
import css from "./planes.module.css";

/** What a click in the scene does: judge a patch, or grow a new one from a point of the cloud. */
export function ClickMode({ recordingId }: { recordingId: string }) {
  const view = useQuery(viewQuery(recordingId));
  const change = useChangeView(recordingId);
  const click = view.data?.click ?? "toggle";
  const set = (wish: "toggle" | "grow") => change.mutate({ click: wish });
  useShortcuts("3D scene", [
    { keys: "c", label: "Click confirms or drops", run: () => set("toggle") },
    { keys: "g", label: "Click grows a plane", run: () => set("grow") },
  ]);
  return (
    <div className={css.clickmode}>
      <SegmentedControl
        size="xs"
        aria-label="What a click in the scene does"
        value={click}
        onChange={(value) => set(value === "grow" ? "grow" : "toggle")}
        data={[
          { value: "toggle", label: "Confirm or drop" },
          { value: "grow", label: "Grow a plane" },
        ]}
      />
      <span className={css.hint}>
        {click === "grow" ? "Click a point of the cloud that lies on a flat surface" : "Click a coloured patch"}
      </span>
    </div>
  );
}
