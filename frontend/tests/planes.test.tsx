import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, render, screen, waitFor } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { describe, expect, it, vi } from "vitest";
import type { DoctorReport, Operation, Patch, Planes } from "../src/api/client";
import { keys } from "../src/api/queries";
import { DeterminacyMeter } from "../src/features/planes/determinacy";
import { cautionOf, doubtOf, lastSolve, remarksOf } from "../src/features/planes/leftout";
import { PatchList, thousands } from "../src/features/planes/list";
import { fewScansText, NoneConfirmed } from "../src/features/planes/screen";
import { mergeCandidates } from "../src/features/planes/similar";
import { culpritsOf } from "../src/features/result/culprits";
import { noiseOrigin } from "../src/features/recording/sensors";
import { NARROW } from "../src/ui/format";
import { usual } from "./usual";

const patch = (index: number, normal: number[], offset_m: number, confirmed = true): Patch => ({
  index,
  name: `plane ${index + 1}`,
  normal,
  offset_m,
  area_m2: 4.2,
  n_points: 1200,
  rms_m: 0.0123,
  tilt_deg: 65,
  confirmed,
  restricted: false,
  insisted: false,
  doubt: "",
  color: "#0072b2",
});

const planes: Planes = {
  patches: [patch(0, [1, 0, 0], 2), patch(1, [-1, 0, 0], -2.1), patch(2, [1, 0, 0], 5), patch(3, [0, 1, 0], 2, false)],
  determinacy: { ok: true, text: "", smallest_eigenvalue: 0.3 },
  upright: true,
  static: true,
  restricted: false,
  can_undo: false,
  can_redo: false,
  revision: 1,
};

function show(rename = vi.fn((_: number, name: string) => Promise.resolve(name)), some = planes) {
  const apply = vi.fn<(operation: Operation) => void>();
  const told = new QueryClient();
  told.setQueryData(keys.facts, { usual });
  render(
    <QueryClientProvider client={told}>
      <MantineProvider env="test">
        <PatchList planes={some} apply={apply} rename={rename} onRestrict={vi.fn()} />
      </MantineProvider>
    </QueryClientProvider>,
  );
  return { apply, rename, user: userEvent.setup() };
}

// Seen: 59k above 9 507. Fails when a column has thousands in two forms; when 9 960 is 10.0k.
it("counts points in one form", () => {
  expect([58_547, 9_960, 9_507, 1_000, 999].map(thousands)).toEqual(["59k", "10k", "9.5k", "1.0k", "999"]);
});

describe("the list of planes", () => {
  // Fails when a dropped plane is drawn as confirmed, or the wrong row's index is sent.
  it("confirms the plane whose box is ticked, and drops it again", async () => {
    const { apply, user } = show();
    const box = screen.getByRole<HTMLInputElement>("checkbox", { name: "Use plane 4" });
    expect(box.checked).toBe(false);
    await user.click(box);
    expect(apply).toHaveBeenCalledExactlyOnceWith({ op: "confirm", index: 3 });
    await user.click(screen.getByRole("checkbox", { name: "Use plane 1" }));
    expect(apply).toHaveBeenLastCalledWith({ op: "drop", index: 0 });
  });

  // Fails when the tilt from the lidar's own horizontal is shown as if it were known which way is down.
  it("shows tilts only where gravity is known", () => {
    show(undefined, { ...planes, upright: false });
    expect(screen.queryByText("65")).toBeNull();
    expect(screen.getAllByText("–")).toHaveLength(4);
    cleanup();
    show();
    expect(screen.getAllByText("65")).toHaveLength(4);
  });

  // Fails when it is denied that there is a standstill, in which the recording's page says that the noise was measured.
  it("says of a standstill what the recording's page says", () => {
    const imu = (noise_used: string, still_spans: unknown[]) =>
      ({ imu: { noise_used, still_spans, measured_noise: { static_s: 2.1 } } }) as unknown as DoctorReport;
    const none =
      "No standstill was found around these planes, so that they come from few scans; the solve refines them.";
    expect(fewScansText(null)).toBe(none);
    expect(fewScansText(imu("moving", []))).toBe(none);
    expect(fewScansText(imu("measured", []))).toContain("The standstill in the IMU’s readings is at another time");
    expect(fewScansText(imu("moving", [{}]))).toContain("The standstill in the IMU’s readings is at another time");
    const report = imu("measured", []).imu;
    if (report === null) throw new Error("no IMU");
    expect(noiseOrigin(report)).toBe(`measured in 2.1${NARROW}s of standstill`);
  });

  // Fails when another row's index is sent, or insisting is a tick as any other.
  it("counts a plane even if doubtful where somebody insists", async () => {
    const { apply, user } = show();
    await user.click(screen.getByRole("button", { name: "More for plane 2" }));
    await user.click(await screen.findByRole("menuitem", { name: "Count it even if doubtful" }));
    expect(apply).toHaveBeenCalledExactlyOnceWith({ op: "insist", index: 1 });
  });

  // Fails when leaving the field with Escape renames all the same.
  it("renames by double click, and not on Escape", async () => {
    const { rename, user } = show();
    await user.dblClick(screen.getByText("plane 3"));
    expect(screen.getByRole("textbox", { name: "New name" })).toBe(document.activeElement);
    await user.keyboard("wall A{Enter}");
    expect(rename).toHaveBeenLastCalledWith(2, "wall A");
    rename.mockClear();
    await user.dblClick(screen.getByText("plane 1"));
    await user.keyboard("floor{Escape}");
    expect(rename).not.toHaveBeenCalled();
    expect(screen.queryByRole("textbox")).toBeNull();
  });

  // Fails when a name that is taken goes with the field; when the reason stays once another one is typed; when it is asked for
  // again on leaving the field.
  it("keeps a name that is refused, with the reason, until another one is typed", async () => {
    const taken = vi.fn((_: number, name: string) =>
      name === "floor" ? Promise.reject(new Error("Another plane is called so.")) : Promise.resolve(name),
    );
    const { rename, user } = show(taken);
    await user.dblClick(screen.getByText("plane 3"));
    await user.keyboard("floor{Enter}");
    expect(await screen.findByText("Another plane is called so.")).toBeTruthy();
    const field = screen.getByRole<HTMLInputElement>("textbox", { name: "New name" });
    expect(field.value).toBe("floor");
    await user.tab();
    expect(rename).toHaveBeenCalledOnce();
    await user.type(field, " 2", { initialSelectionStart: 5, initialSelectionEnd: 5 });
    expect(screen.queryByText("Another plane is called so.")).toBeNull();
    await user.keyboard("{Enter}");
    await waitFor(() => expect(screen.queryByRole("textbox")).toBeNull());
    expect(rename.mock.calls).toEqual([
      [2, "floor"],
      [2, "floor 2"],
    ]);
  });
});

describe("the way on without a confirmed plane", () => {
  const shown = (found: number) => {
    const [onSuggestion, onGrow] = [vi.fn(), vi.fn()];
    render(
      <MantineProvider env="test">
        <NoneConfirmed found={found} onSuggestion={onSuggestion} onGrow={onGrow} />
      </MantineProvider>,
    );
    return { onSuggestion, onGrow, user: userEvent.setup() };
  };

  // Fails when there is a button that does nothing and says nothing.
  it("is the suggestion, and a plane grown by hand where none was found", async () => {
    const some = shown(6);
    expect(screen.getByText(/none is confirmed/)).toBeTruthy();
    await some.user.click(screen.getByRole("button", { name: "Use the suggestion" }));
    expect(some.onSuggestion).toHaveBeenCalledOnce();
    const none = shown(0);
    expect(screen.getByText(/none was found/)).toBeTruthy();
    await none.user.click(screen.getByRole("button", { name: "Grow a plane" }));
    expect(none.onGrow).toHaveBeenCalledOnce();
  });
});

describe("candidates for a merge", () => {
  // Fails when a plane with the opposite normal counts as another one.
  it("are those at the same place, whichever way their normals point", () => {
    const [first] = planes.patches;
    if (first === undefined) throw new Error("no patch");
    expect(mergeCandidates(first, planes.patches, usual).map((one) => one.index)).toEqual([1]);
  });

  // Fails when the page has a nearness of its own: 12 degrees, 0.4 m.
  it("are as near as the server says", () => {
    const first = patch(0, [1, 0, 0], 2);
    const turned = (deg: number) => [Math.cos((deg * Math.PI) / 180), Math.sin((deg * Math.PI) / 180), 0];
    const others = [
      patch(1, turned(9), 2),
      patch(2, turned(11), 2),
      patch(3, [1, 0, 0], 2.45),
      patch(4, [1, 0, 0], 2.55),
    ];
    expect(mergeCandidates(first, others, usual).map((one) => one.index)).toEqual([1, 3]);
  });
});

describe("the meter of what planes determine", () => {
  const meter = (hopeless: string, weak: boolean, caution = "") => {
    const axis = {
      name: "Position z",
      std: 1.5,
      unit: "m",
      limit: 0.02,
      weak,
      text: weak ? "Tilt the rig." : "",
    } as const;
    const { unmount } = render(
      <MantineProvider env="test">
        <DeterminacyMeter determinacy={planes.determinacy} foreseen={axis} hopeless={hopeless} caution={caution} />
      </MantineProvider>,
    );
    const shown = screen.getByRole("status");
    const seen = [shown.dataset["ok"], shown.textContent];
    unmount();
    return seen;
  };

  // Fails when planes that fix all directions are green whatever the recording tells; when the reason is not said.
  it("is no green where no planes help", () => {
    expect(meter("", false)[0]).toBe("true");
    expect(meter("", true)).toEqual(["false", expect.stringContaining("Tilt the rig.")]);
    expect(meter("The lidar stood still.", false)).toEqual([
      "false",
      expect.stringContaining("The lidar stood still."),
    ]);
  });

  // Fails when a doubtful plane that is insisted on leaves the number, or the green, of those beyond doubt; when one that is not
  // insisted on, or dropped, or sound, takes it away; when what a run has found is forgotten.
  it("foretells nothing of a doubtful plane that is insisted on", () => {
    const seems = "does not seem to be flat";
    const some = (doubt: string, insisted: boolean, confirmed = true) => [
      { ...patch(0, [1, 0, 0], 2, confirmed), doubt, insisted },
      patch(1, [0, 1, 0], 2),
    ];
    const caution = cautionOf(some(seems, true), undefined);
    expect(caution).toContain("plane 1 is used though doubtful");
    const [ok, text] = meter("", false, caution);
    expect(ok).toBe("false");
    expect(text).toContain("plane 1 is used though doubtful");
    expect(text).not.toContain("Position z");
    for (const fine of [some(seems, false), some(seems, true, false), some("", true)])
      expect(cautionOf(fine, undefined)).toBe("");
    expect(cautionOf(some("", true), new Map([[0, "doubtful in run 2: not flat"]]))).not.toBe("");
    expect(cautionOf(some("", true), new Map([[1, "doubtful in run 2: not flat"]]))).toBe("");
    expect(doubtOf({ ...patch(0, [1, 0, 0], 2), doubt: seems })).toBe(`${seems}: likely to be left out`);
    expect(doubtOf({ ...patch(0, [1, 0, 0], 2), doubt: seems, insisted: true })).toBe(seems);
    expect(doubtOf(patch(0, [1, 0, 0], 2))).toBeUndefined();
  });
});

describe("what the last solve left out", () => {
  const color = "#0072b2";
  const look = (name: string, title = name, shade = color) => ({ name, title, color: shade, restricted: false });
  const run = (looks: unknown[], kind: string | null = "solve") =>
    ({ job: { planes: looks, result: kind === null ? null : { kind } } }) as never;
  const solved = run([
    look("plane 9", "plane 1"),
    look("plane 2"),
    look("plane 3"),
    look("plane 4", "plane 4", "#000000"),
  ]);
  const message = (code: string, text: string) => ({ level: "warning", code, text });
  const result = (used: string[], ...messages: unknown[]) =>
    ({ quality: { planes: used.map((name) => ({ name })) }, messages }) as never;

  // Fails when a renamed plane is not known again; when one that counts is marked; when another plane's message is taken for it.
  it("is said beside the plane, with the reason", () => {
    const told = result(
      ["plane 2"],
      message("planes.bent", "plane 9 is not flat: left out"),
      message(
        "planes.unseen",
        "plane 2 did not stand still, and 4 of 1,000,004 points lie on it in the end: it counts for nothing, and may not be where it was put",
      ),
      message("planes.dropped", "plane 3 does not fit the motion of the other planes: left out"),
    );
    expect([...remarksOf(planes.patches, solved, 2, told)]).toEqual([
      [0, "left out by run 2: not flat"],
      [2, "left out by run 2: does not fit the motion of the other planes"],
    ]);
  });

  // Fails when what was left out, was dropped since, or belongs to another colour is offered to be left out.
  it("offers to leave out what is doubtful and counted", () => {
    const counts = (name: string) =>
      message("planes.doubted", `${name} is not flat, but is used because it was chosen: leave it out`);
    const said = [counts("plane 9"), counts("plane 4"), message("planes.bent", "plane 2 is not flat: left out")];
    const { job } = solved as unknown as { job: Parameters<typeof culpritsOf>[1] };
    const found = culpritsOf(planes.patches, job, said as never);
    expect(found.map(({ name }) => name)).toEqual(["plane 1"]);
    const dropped = planes.patches.map((one) => ({ ...one, confirmed: false }));
    expect(culpritsOf(dropped, job, said as never)).toEqual([]);
  });

  // Fails when one that counted is marked as left out, or not at all; when the sound ones are; when results of older versions
  // are not understood.
  it("is said of those that counted though they are doubtful", () => {
    const text = "plane 9 is not flat, but is used because it was chosen: leave it out and solve again";
    const used = result(["plane 9", "plane 2", "plane 3"], { level: "warning", code: "planes.doubted", text });
    expect([...remarksOf(planes.patches, solved, 3, used)]).toEqual([[0, "doubtful in run 3: not flat"]]);
    const older = "plane 9 is not flat, and counts all the same, as the choice has it: leave it out and solve again";
    const kept = result(["plane 9", "plane 2", "plane 3"], { level: "warning", code: "planes.doubted", text: older });
    expect([...remarksOf(planes.patches, solved, 3, kept)]).toEqual([[0, "doubtful in run 3: not flat"]]);
  });

  // Fails when a run that was refused for planes marks none of them, or all; when a name that begins another's is taken for it.
  it("is said of those that a refusal names", () => {
    const refusal = (code: string, text: string) => result([], { level: "error", code, text });
    const doubtful = refusal(
      "planes.doubtful",
      "the chosen planes do not determine the motion: plane 9 is not flat, plane 2 did not stand still, and the others do not face three different directions; choose walls",
    );
    expect([...remarksOf(planes.patches, solved, 3, doubtful)]).toEqual([
      [0, "run 3 was refused for it: not flat"],
      [1, "run 3 was refused for it: did not stand still"],
    ]);
    const unsettled = refusal(
      "planes.unsettled",
      "the solve did not converge with the chosen planes: plane 3 is more than one surface; leave out what can move",
    );
    expect([...remarksOf(planes.patches, solved, 3, unsettled)]).toEqual([
      [2, "run 3 was refused for it: more than one surface"],
    ]);
    expect(remarksOf(planes.patches, solved, 3, refusal("planes.doubtful", "a: plane 22 is not flat; b")).size).toBe(0);
  });

  // Fails when a refused run that lists no planes marks all of them.
  it("is not guessed", () => {
    expect(remarksOf(planes.patches, solved, 2, result([])).size).toBe(0);
    expect([...remarksOf(planes.patches, solved, 2, result(["plane 9", "plane 2"]))]).toEqual([
      [2, "left out by run 2"],
    ]);
  });

  // Fails when a run that waits or failed hides the last that solved, or the numbers count from the wrong end.
  it("is of the newest run that ended with a result", () => {
    expect(lastSolve([run([look("a")], null), solved, solved, solved])).toEqual({ run: solved, number: 3 });
    expect(lastSolve([])).toBeNull();
  });

  // Fails when the remark is not on the page, or takes the plane out of the choice by itself.
  it("leaves the choice alone", () => {
    const client = new QueryClient();
    client.setQueryData(keys.facts, { usual });
    const asked = { apply: vi.fn(), rename: vi.fn(), onRestrict: vi.fn() };
    render(
      <QueryClientProvider client={client}>
        <MantineProvider env="test">
          <PatchList planes={planes} remarks={new Map([[0, "left out by run 2: not flat"]])} {...asked} />
        </MantineProvider>
      </QueryClientProvider>,
    );
    expect(screen.getByText("left out by run 2: not flat").closest("tr")?.textContent).toContain("plane 1");
    expect(screen.getByRole<HTMLInputElement>("checkbox", { name: "Use plane 1" }).checked).toBe(true);
    expect(asked.apply).not.toHaveBeenCalled();
  });
});
