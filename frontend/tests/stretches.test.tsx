import { MantineProvider } from "@mantine/core";
import { render, screen } from "@testing-library/react";
import { expect, it, vi } from "vitest";
import { PartsSection } from "../src/features/result/parts";

// What draws wants a canvas.
vi.mock("../src/ui/lineplot", () => ({ LinePlot: () => null }));

const block = {
  t_start_s: 0,
  t_end_s: 1,
  rotation_shift_deg: [9, 9, 9],
  translation_shift_m: [9, 9, 9],
  time_offset_shift_s: 9,
  rotation_std_deg: [1, 1, 1],
  translation_std_m: [1, 1, 1],
  time_offset_std_s: 1,
};
const result = { evidence: { parts: { time_blocks: [block] }, time_offset_profile: null } } as never;

// Fails when the page counts for itself what the report counts too, or leaves out what it is told.
it.each([
  ["5 of 7 bars do, as expected from noise", /cross zero, without a trend: 5 of 7 bars do, as expected from noise\.$/],
  ["", /cross zero, without a trend\.$/],
])("stretches' answers cross zero as the server counts: %s", (crossings, said) => {
  render(
    <MantineProvider env="test">
      <PartsSection result={result} crossings={crossings} />
    </MantineProvider>,
  );
  expect(screen.getByText(said)).toBeTruthy();
});
