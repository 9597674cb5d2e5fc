import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { render, screen } from "@testing-library/react";
import userEvent from "@testing-library/user-event";
import { MemoryRouter } from "react-router";
import { describe, expect, it, vi } from "vitest";
import type { Job, Recording } from "../src/api/client";
import type { RunLog } from "../src/api/jobstream";
import { emptyRun } from "../src/api/jobstream";
import { keys } from "../src/api/queries";
import { ExcludeSection } from "../src/features/inspect/exclude";
import type { TimeSpan } from "../src/features/inspect/spans";
import { JobProgress } from "../src/features/jobs/progress";
import { Reading, readingPlace } from "../src/features/recording/reading";
import { SolveOptions } from "../src/features/solve/options";
import { usual } from "./usual";

const settings = {
  method: "full",
  points_per_plane_per_scan: null,
  field_of_view_deg: null,
  gravity: { magnitude_m_s2: 9.807, std_m_s2: 0.02 },
  imu_noise: null,
  estimate_time_offset: true,
  estimate_planes: true,
  bias_model: "random-walk",
  imu_sampling: "detect",
  lidar_sampling: "detect",
  priors: [
    { axis: "tx", value: 0.1, std: 0.005 },
    { axis: "tz", value: 0.3, std: 0.005 },
  ],
  random_seed: 0,
  max_rounds: 14,
  excluded_spans_s: [],
  intrinsics: "auto",
  lidar: null,
} as unknown as Job["settings"];

function show(what: React.ReactNode, at = "/") {
  const client = new QueryClient({ defaultOptions: { queries: { staleTime: Infinity } } });
  client.setQueryData(keys.facts, {
    usual,
    imu_presets: [],
    lidar_presets: [],
    axis_names: { tx: "Position x", tz: "Position z" },
    solve_settings: settings,
  });
  const page = (inner: React.ReactNode) => (
    <MemoryRouter initialEntries={[at]}>
      <QueryClientProvider client={client}>
        <MantineProvider env="test">{inner}</MantineProvider>
      </QueryClientProvider>
    </MemoryRouter>
  );
  const { rerender } = render(page(what));
  return { user: userEvent.setup(), again: (inner: React.ReactNode) => rerender(page(inner)) };
}

describe("the options of a solve", () => {
  const options = (onSolve = vi.fn()) => (
    <SolveOptions
      recordingId="1"
      title="How to solve"
      action="Solve again"
      formId="f"
      before={settings}
      onSolve={onSolve}
      pending={false}
      error={null}
    />
  );

  // Fails when it is only said that some number is missing; when nobody is led to it, folded away as it is.
  it("name the field that is wrong, and lead to it", async () => {
    const onSolve = vi.fn();
    const { user } = show(options(onSolve));
    const seed = screen.getByRole("textbox", { name: "Seed of the plane search", hidden: true });
    const folded = seed.closest("details");
    if (folded !== null) folded.open = true;
    await user.type(seed, "1.5");
    if (folded !== null) folded.open = false;
    expect(screen.queryByRole("alert")).toBeNull();
    await user.click(screen.getByRole("button", { name: "Solve again" }));
    expect(screen.getByRole("alert").textContent).toBe("Seed of the plane search: a whole number.");
    expect(document.activeElement).toBe(seed);
    expect(folded?.open).toBe(true);
    await user.clear(seed);
    expect(screen.queryByRole("alert")).toBeNull();
    expect(onSolve).not.toHaveBeenCalled();
    await user.click(screen.getByRole("button", { name: "Solve again" }));
    expect(onSolve).toHaveBeenCalledOnce();
  });

  // Fails when who comes to correct a number that was given has to look for it.
  it("begin at the number that somebody was sent to", () => {
    show(options(), "/r/ab/solve?job=j&known=tz");
    expect(document.activeElement).toBe(screen.getByRole("textbox", { name: "Value of Position z, mm" }));
  });

  // Fails when who is told to name the IMU is left before a folded form.
  it("begin at the sensor that somebody is to name", () => {
    show(options(), "/r/ab/solve?job=j&known=imuNoise");
    const imu = screen.getByRole("combobox", { name: "IMU noise" });
    expect(document.activeElement).toBe(imu);
    expect(imu.closest("details")?.open).toBe(true);
  });
});

describe("how a recording is read", () => {
  const recording = { state: "ready", read_settings: { range_min_m: 0.5, range_max_m: 100 }, report: null };

  // Fails when the controls come up below the fold and nobody is led to them.
  it("is said where one is led to", async () => {
    const seen = vi.spyOn(Element.prototype, "scrollIntoView");
    const { user } = show(<Reading recording={recording as unknown as Recording} />);
    expect(seen).not.toHaveBeenCalled();
    await user.click(screen.getByText("Correct what was recognised"));
    await vi.waitFor(() => expect(document.activeElement?.tagName).toBe("SELECT"));
    expect(seen).toHaveBeenCalledOnce();
  });

  // Fails when the result's "See how it was read" leads to the top of the page.
  it("is open for who was sent there", () => {
    show(<Reading recording={recording as unknown as Recording} />, `/r/ab/recording#${readingPlace}`);
    expect(document.activeElement?.tagName).toBe("SELECT");
  });
});

describe("a scan that is left out", () => {
  const section = (wished: TimeSpan[], onChange: (spans: TimeSpan[]) => void) => (
    <ExcludeSection
      wished={wished}
      done={[]}
      scan={40}
      scanTimeS={4}
      periodS={0.1}
      worst={null}
      onScan={vi.fn()}
      onChange={onChange}
      onSolve={vi.fn()}
      pending={false}
      error={null}
    />
  );

  // Fails when the button looks the same whether the scan is left out or not, or can only leave out.
  it("is shown by the button that leaves it out, and had back with it", async () => {
    let spans: TimeSpan[] = [];
    const onChange = (now: TimeSpan[]) => {
      spans = now;
    };
    const { user, again } = show(section(spans, onChange));
    const button = () => screen.getByRole("button", { name: "Leave out scan 41" });
    expect(button().getAttribute("aria-pressed")).toBe("false");
    await user.click(button());
    again(section(spans, onChange));
    expect(button().getAttribute("aria-pressed")).toBe("true");
    await user.click(button());
    expect(spans).toEqual([]);
  });
});

describe("a job that waits", () => {
  const run = (state: string, place: number | null): RunLog => ({
    ...emptyRun,
    job: { id: "j1", state, queue_place: place, started_at: null, ended_at: null } as unknown as Job,
  });

  // Fails when it is 0 % done, or starting, while it waits.
  it("says so, and its place, and nothing else", () => {
    const { again } = show(<JobProgress run={run("queued", 3)} jobId="j1" expected={["solve"]} />);
    expect(screen.getByText("Waiting, place 3 in the queue")).toBeTruthy();
    expect(screen.queryByText("Starting")).toBeNull();
    expect(screen.queryByText(/%/)).toBeNull();
    again(<JobProgress run={run("running", null)} jobId="j1" expected={["solve"]} />);
    expect(screen.getByText("Starting")).toBeTruthy();
    expect(screen.getByText("0 %")).toBeTruthy();
  });
});
