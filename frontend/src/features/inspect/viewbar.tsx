import { Button, NativeSelect, SegmentedControl } from "@mantine/core";
import { viewPageUrl } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { useShortcuts } from "../../ui/shortcuts";
import { nameOfOld } from "./oldtext";
import css from "./inspect.module.css";
import type { ColorBy, Extent, InspectWish, Show } from "./wish";

const shows: { value: Show; label: string; key: string; said: string }[] = [
  { value: "raw", label: "Raw", key: "r", said: "Raw cloud" },
  { value: "deskewed", label: "De-skewed", key: "d", said: "De-skewed cloud" },
  { value: "old", label: "Old", key: "o", said: "With the old extrinsic" },
  { value: "both", label: "Both", key: "b", said: "Both in one place" },
  { value: "side", label: "Side by side", key: "s", said: "Side by side" },
  { value: "wipe", label: "Wipe", key: "w", said: "Wipe between both" },
];

const extents: { value: Extent; label: string }[] = [
  { value: "scan", label: "One scan" },
  { value: "map", label: "Map" },
  { value: "surface", label: "Surface" },
];

const colorings: { value: ColorBy; label: string }[] = [
  { value: "plane", label: "Colour: plane" },
  { value: "time", label: "Colour: time in the sweep" },
  { value: "residual", label: "Colour: distance to plane" },
  { value: "intensity", label: "Colour: intensity" },
];

interface ViewBarProps {
  recordingId: string;
  wish: InspectWish;
  change: (part: Partial<InspectWish>) => void;
}

/** What the scene shows, and by what it is coloured. */
export function ViewBar({ recordingId, wish, change }: ViewBarProps) {
  const offered = shows
    .filter((show) => show.value !== "old" || wish.old !== null)
    .map((show) =>
      show.value === "old"
        ? { ...show, label: nameOfOld(wish.old, show.label), said: `With ${nameOfOld(wish.old, "the old extrinsic")}` }
        : show,
    );
  const compares = wish.old !== null && (wish.show === "both" || wish.show === "wipe");
  const nextExtent = () => {
    const at = extents.findIndex((extent) => extent.value === wish.extent);
    change({ extent: extents[(at + 1) % extents.length]?.value ?? "scan" });
  };
  const nextColor = () => {
    const at = colorings.findIndex((color) => color.value === wish.colorBy);
    const next = colorings[(at + 1) % colorings.length];
    if (next !== undefined) change({ colorBy: next.value });
  };
  useShortcuts("What the scene shows", [
    ...offered.map((show) => ({ keys: show.key, label: show.said, run: () => change({ show: show.value }) })),
    { keys: "m", label: "One scan, the map of all or its surface", run: nextExtent },
    { keys: "c", label: "Next colouring", run: nextColor },
  ]);
  return (
    <div className={css.viewbar}>
      <SegmentedControl
        size="xs"
        aria-label="What the scene shows"
        value={wish.show}
        data={offered.map(({ value, label }) => ({ value, label }))}
        onChange={(value) => {
          const show = shows.find((one) => one.value === value);
          if (show !== undefined) change({ show: show.value });
        }}
      />
      <SegmentedControl
        size="xs"
        aria-label="One scan, the map or its surface"
        value={wish.extent}
        data={extents.map(({ value, label }) => ({ value, label }))}
        onChange={(value) => {
          const extent = extents.find((one) => one.value === value);
          if (extent !== undefined) change({ extent: extent.value });
        }}
      />
      {compares && (
        <NativeSelect
          size="xs"
          w={132}
          aria-label="Compare with"
          data={[
            { value: "raw", label: "against raw" },
            { value: "old", label: `against ${nameOfOld(wish.old, "old")}` },
          ]}
          value={wish.against}
          onChange={(event) => change({ against: event.currentTarget.value === "old" ? "old" : "raw" })}
        />
      )}
      {wish.show !== "both" && wish.extent !== "surface" && (
        <NativeSelect
          size="xs"
          w={184}
          aria-label="Colour by"
          data={colorings}
          value={wish.colorBy}
          onChange={(event) => {
            const color = colorings.find((one) => one.value === event.currentTarget.value);
            if (color !== undefined) change({ colorBy: color.value });
          }}
        />
      )}
      <Button
        component="a"
        href={viewPageUrl(recordingId)}
        download
        size="xs"
        variant="default"
        leftSection={<Icon name="download" size={13} />}
        aria-label="Save this view as a 3D page"
      >
        3D page
      </Button>
    </div>
  );
}
