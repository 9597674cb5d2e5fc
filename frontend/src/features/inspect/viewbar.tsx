import { NativeSelect, SegmentedControl } from "@mantine/core";
import { useShortcuts } from "../../ui/shortcuts";
import css from "./inspect.module.css";
import type { ColorBy, InspectWish, Show } from "./wish";

const shows: { value: Show; label: string; key: string }[] = [
  { value: "raw", label: "Raw", key: "r" },
  { value: "deskewed", label: "De-skewed", key: "d" },
  { value: "both", label: "Both", key: "b" },
  { value: "map", label: "Map", key: "m" },
];

const colorings: { value: ColorBy; label: string }[] = [
  { value: "plane", label: "Colour: plane" },
  { value: "time", label: "Colour: time in the sweep" },
  { value: "residual", label: "Colour: distance to plane" },
  { value: "intensity", label: "Colour: intensity" },
];

interface ViewBarProps {
  wish: InspectWish;
  change: (part: Partial<InspectWish>) => void;
}

/** What the scene shows, and by what it is coloured. */
export function ViewBar({ wish, change }: ViewBarProps) {
  const nextColor = () => {
    const at = colorings.findIndex((color) => color.value === wish.colorBy);
    const next = colorings[(at + 1) % colorings.length];
    if (next !== undefined) change({ colorBy: next.value });
  };
  useShortcuts("What the scene shows", [
    ...shows.map((show) => ({ keys: show.key, label: show.label, run: () => change({ show: show.value }) })),
    { keys: "c", label: "Next colouring", run: nextColor },
  ]);
  return (
    <div className={css.viewbar}>
      <SegmentedControl
        size="xs"
        aria-label="What the scene shows"
        value={wish.show}
        data={shows.map(({ value, label }) => ({ value, label }))}
        onChange={(value) => {
          const show = shows.find((one) => one.value === value);
          if (show !== undefined) change({ show: show.value });
        }}
      />
      <NativeSelect
        size="xs"
        w={200}
        aria-label="Colour by"
        data={colorings}
        value={wish.colorBy}
        onChange={(event) => {
          const color = colorings.find((one) => one.value === event.currentTarget.value);
          if (color !== undefined) change({ colorBy: color.value });
        }}
      />
    </div>
  );
}
