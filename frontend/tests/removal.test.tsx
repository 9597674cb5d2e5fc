import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { render, screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { MemoryRouter } from "react-router";
import { describe, expect, it, vi } from "vitest";
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
    sure.focus();
    await user.keyboard("{Enter}");
    expect(remove).toHaveBeenCalledExactlyOnceWith(recording.id);
  });
});
