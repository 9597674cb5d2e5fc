import { ActionIcon, SegmentedControl, Tooltip } from "@mantine/core";
import type { View } from "../../api/client";
import { useChangeView } from "../../api/changes";
import { useUsual } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { useShortcuts } from "../../ui/shortcuts";
import css from "./layout.module.css";

type Preset = View["preset"];

const presets: { value: Preset; label: string }[] = [
  { value: "overview", label: "Cut open" },
  { value: "inside", label: "Inside" },
  { value: "top", label: "Top" },
  { value: "front", label: "Front" },
];

const step = 1.25;

/** From where the scene is looked at, and how large its points are. */
export function SceneTools({ recordingId, view }: { recordingId: string; view: View }) {
  const { mutate } = useChangeView(recordingId);
  const usual = useUsual();
  const smallest = usual?.smallest_points ?? view.point_scale;
  const largest = usual?.largest_points ?? view.point_scale;
  // Pressed again, a way to look is gone back to after the view was turned by hand.
  const look = (preset: Preset) => mutate({ preset, looks: view.looks + 1 });
  const size = (factor: number) =>
    mutate({ point_scale: Math.min(largest, Math.max(smallest, view.point_scale * factor)) });
  const next = () =>
    look(presets[(presets.findIndex((one) => one.value === view.preset) + 1) % presets.length]?.value ?? "overview");
  useShortcuts("The view", [
    { keys: "v", label: "Next way to look at the room", run: next },
    { keys: "+", label: "Larger points", run: () => size(step) },
    { keys: "-", label: "Smaller points", run: () => size(1 / step) },
  ]);
  return (
    <div className={css.tools} role="group" aria-label="How the scene is looked at">
      <SegmentedControl
        size="xs"
        aria-label="Look from"
        value={view.preset}
        data={presets.map(({ value, label }) => ({ value, label }))}
        onChange={(value) => {
          const preset = presets.find((one) => one.value === value);
          if (preset !== undefined) look(preset.value);
        }}
      />
      <Tooltip label="Go back to this view">
        <ActionIcon size={30} variant="default" aria-label="Go back to this view" onClick={() => look(view.preset)}>
          <Icon name="restart" size={14} />
        </ActionIcon>
      </Tooltip>
      <ActionIcon.Group>
        <ActionIcon
          size={30}
          variant="default"
          aria-label="Smaller points"
          disabled={view.point_scale <= smallest}
          onClick={() => size(1 / step)}
        >
          <span className={css.dotSmall} />
        </ActionIcon>
        <ActionIcon
          size={30}
          variant="default"
          aria-label="Larger points"
          disabled={view.point_scale >= largest}
          onClick={() => size(step)}
        >
          <span className={css.dotLarge} />
        </ActionIcon>
      </ActionIcon.Group>
    </div>
  );
}
