import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider, useQuery } from "@tanstack/react-query";
import { act, renderHook, screen, waitFor, render } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { describe, expect, it, vi } from "vitest";
import type { Operation, Planes } from "../src/api/client";
import { api } from "../src/api/client";
import { planesQuery, useEditPlanes } from "../src/api/planes";
import { keys } from "../src/api/queries";
import { PatchList } from "../src/features/planes/list";
import { usual } from "./usual";

const planesAt = (revision: number, ...confirmed: boolean[]): Planes => ({
  patches: confirmed.map((used, index) => ({
    index,
    name: `wall ${index + 1}`,
    normal: [1, 0, 0],
    offset_m: index,
    area_m2: 4.2,
    n_points: 1200,
    rms_m: 0.0123,
    tilt_deg: 65,
    confirmed: used,
    restricted: false,
    insisted: false,
    doubt: "",
    color: "#0072b2",
  })),
  determinacy: { ok: true, text: "", smallest_eigenvalue: 0.3 },
  upright: true,
  static: true,
  restricted: false,
  can_undo: revision > 0,
  can_redo: false,
  revision,
});

const ok = (planes: Planes) => ({ data: planes, response: new Response("{}") });

/** What is drawn once a change has come through. */
const settled = (change: () => void) =>
  act(async () => {
    change();
    await Promise.resolve();
  });

/** A server whose answers are given by hand, and a page that edits its planes. */
function edit() {
  const answers: ((planes: Planes) => void)[] = [];
  const asked: Operation[] = [];
  vi.spyOn(api, "POST").mockImplementation(((_: string, { body }: { body: Operation }) => {
    asked.push(body);
    return new Promise((resolve) => answers.push((planes) => resolve(ok(planes))));
  }) as never);
  const reads: ((planes: Planes) => void)[] = [];
  vi.spyOn(api, "GET").mockImplementation(
    (() => new Promise((resolve) => reads.push((planes) => resolve(ok(planes))))) as never,
  );
  const client = new QueryClient();
  client.setQueryData(keys.planes("ab12"), planesAt(0, true, true, true));
  const { result } = renderHook(
    () => ({
      planes: useQuery({ ...planesQuery("ab12"), staleTime: Infinity }).data,
      edit: useEditPlanes("ab12"),
    }),
    { wrapper: ({ children }) => <QueryClientProvider client={client}>{children}</QueryClientProvider> },
  );
  return {
    asked,
    client,
    apply: (operation: Operation) => settled(() => result.current.edit.mutate(operation)),
    answer: (planes: Planes) => settled(() => answers.shift()?.(planes)),
    read: (planes: Planes) => settled(() => reads.shift()?.(planes)),
    used: () => result.current.planes?.patches.map((patch) => patch.confirmed),
    planes: () => result.current.planes,
  };
}

describe("edits that come faster than their answers", () => {
  // Fails when what was ticked is drawn as it was until the server has answered; when there is nothing to take back until then.
  it("show at once, and can be taken back at once", async () => {
    const { apply, used, planes } = edit();
    await apply({ op: "drop", index: 1 });
    await waitFor(() => expect(used()).toEqual([true, false, true]));
    expect(planes()?.can_undo).toBe(true);
  });

  // Fails when the first answer unticks what was ticked while it was on its way.
  it("stay as they were made when an earlier one is answered", async () => {
    const { apply, answer, asked, used } = edit();
    await apply({ op: "drop", index: 0 });
    await apply({ op: "drop", index: 2 });
    await waitFor(() => expect(used()).toEqual([false, true, false]));
    await answer(planesAt(1, false, true, true));
    await waitFor(() => expect(asked).toHaveLength(2));
    expect(used()).toEqual([false, true, false]);
    await answer(planesAt(2, false, true, false));
    expect(used()).toEqual([false, true, false]);
  });

  // Fails when any answer replaces what is known: an undo pressed then was for nothing, since there seemed to be nothing to undo.
  it("are not undone by an answer that was overtaken", async () => {
    const { apply, answer, read, client, planes } = edit();
    void client.invalidateQueries({ queryKey: keys.planes("ab12") });
    await apply({ op: "rename", index: 0, name: "door" });
    await answer({ ...planesAt(1, true, true, true), can_undo: true });
    await read(planesAt(0, true, true, true));
    await waitFor(() => expect(client.isFetching()).toBe(0));
    expect(planes()?.revision).toBe(1);
    expect(planes()?.can_undo).toBe(true);
  });
});

describe("a plane's name", () => {
  // Fails when the field opens before the menu has gone, which takes the focus away from it and so ends the renaming.
  it("can be typed as soon as Rename was chosen in the menu", async () => {
    const client = new QueryClient();
    client.setQueryData(keys.facts, { usual });
    const rename = vi.fn((_: number, name: string) => Promise.resolve(name));
    render(
      <QueryClientProvider client={client}>
        <MantineProvider env="test">
          <PatchList planes={planesAt(0, true, true)} apply={vi.fn()} rename={rename} onRestrict={vi.fn()} />
        </MantineProvider>
      </QueryClientProvider>,
    );
    const user = userEvent.setup();
    await user.click(screen.getByRole("button", { name: "More for wall 2" }));
    await user.click(await screen.findByRole("menuitem", { name: "Rename", hidden: true }));
    const field = await screen.findByRole("textbox", { name: "New name" });
    expect(screen.queryByRole("menu", { hidden: true })).toBeNull();
    expect(document.activeElement).toBe(field);
    await user.keyboard("door{Enter}");
    expect(rename).toHaveBeenCalledExactlyOnceWith(1, "door");
    await waitFor(() => expect(screen.queryByRole("textbox", { name: "New name" })).toBeNull());
    expect(rename).toHaveBeenCalledOnce();
  });
});
