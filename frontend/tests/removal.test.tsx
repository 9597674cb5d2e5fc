import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { render, screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { MemoryRouter } from "react-router";
import { describe, expect, it, vi } from "vitest";
import { readFileSync } from "node:fs";
import type { Recording } from "../src/api/client";
import { keys } from "../src/api/queries";
import { RecentRecordings } from "../src/features/start/recent";

const remove = vi.hoisted(() => vi.fn());
vi.mock("../src/api/changes", async (original) => ({
  ...(await original<typeof import("../src/api/changes")>()),
  useDeleteRecording: () => ({ mutate: remove, isPending: false }),
}));

const recording = {
  id: "a".repeat(32),
  name: "room.bag",
  note: "",
  size_bytes: 9,
  state: "ready",
  report: null,
  created_at: "2026-01-01T00:00:00Z",
  latest_job: null,
} as unknown as Recording;

const styles = readFileSync("src/styles.css", "utf8");

/** WCAG 2.1's contrast of two colours #rrggbb. */
function contrast(...colors: [string, string]): number {
  const [low = 0, high = 0] = colors
    .map((color) => {
      const [r = 0, g = 0, b = 0] = [1, 3, 5]
        .map((at) => parseInt(color.slice(at, at + 2), 16) / 255)
        .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
      return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    })
    .sort((a, b) => a - b);
  return (high + 0.05) / (low + 0.05);
}

// Fails when what says that something goes for good cannot be read on its own wash.
it.each(["dark", "light"])("has inks of alarm that are read on their washes in the %s theme", (scheme) => {
  const block = styles.split(`[data-mantine-color-scheme="${scheme}"] {`)[1]?.split("}")[0] ?? "";
  const token = (name: string) => new RegExp(`--${name}: (#[0-9a-f]{6});`).exec(block)?.[1] ?? "";
  for (const ink of ["good", "warn", "bad"]) expect(contrast(token(ink), token(`${ink}-wash`))).toBeGreaterThan(4.5);
});

describe("removing a recording", () => {
  // Fails when the second click of a double one answers the question that the first one asked: the hours of a recording are gone.
  it("takes two clicks that are meant", async () => {
    const told = new QueryClient({ defaultOptions: { queries: { staleTime: Infinity } } });
    told.setQueryData(keys.recordings, [recording]);
    render(
      <QueryClientProvider client={told}>
        <MantineProvider env="test">
          <MemoryRouter>
            <RecentRecordings onOpen={vi.fn()} />
          </MemoryRouter>
        </MantineProvider>
      </QueryClientProvider>,
    );
    const user = userEvent.setup();
    await user.click(screen.getByRole("button", { name: "More for room.bag" }));
    await user.dblClick(await screen.findByRole("menuitem", { name: "Remove…" }));
    expect(remove).not.toHaveBeenCalled();
    const sure = screen.getByRole("menuitem", { name: "Yes, remove it and its results" });
    // Mantine's own red, red on its red wash under the pointer: 2.75 and 2.26 to 1.
    expect(sure.style.getPropertyValue("--menu-item-color")).toBe("");
    sure.focus();
    await user.keyboard("{Enter}");
    expect(remove).toHaveBeenCalledExactlyOnceWith(recording.id);
  });
});
