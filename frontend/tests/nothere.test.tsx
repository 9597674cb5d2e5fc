import { MantineProvider } from "@mantine/core";
import { render, screen } from "@testing-library/react";
import { MemoryRouter } from "react-router";
import { expect, it } from "vitest";
import { NotHere } from "../src/features/planes/screen";

// Seen: a page that was reloaded while it sent looked for planes for ever. Fails when it is not said why there are none, or where
// to go on.
it.each([
  [
    { id: "a", state: "receiving", origin: "upload", received_bytes: 25, size_bytes: 100 },
    "Upload at 25 %: there are no planes before the recording has been read.",
  ],
  [
    { id: "a", state: "failed", latest_job: { kind: "inspect", state: "interrupted", result: null } },
    "Reading was interrupted: there are no planes before the recording has been read.",
  ],
])("says why there are no planes yet: %s", (recording, said) => {
  render(
    <MantineProvider env="test">
      <MemoryRouter>
        <NotHere recording={recording as never} />
      </MemoryRouter>
    </MantineProvider>,
  );
  expect(screen.getByText(said)).toBeTruthy();
  expect(screen.getByRole("link", { name: "Back to the recording" }).getAttribute("href")).toBe("/r/a/recording");
});
