import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { render, screen } from "@testing-library/react";
import type { ReactNode } from "react";
import { MemoryRouter } from "react-router";
import { describe, expect, it } from "vitest";
import { ViewBar } from "../src/features/inspect/viewbar";
import { readWish } from "../src/features/inspect/wish";
import { keys } from "../src/api/queries";
import { cloudsQuery, Compare, sidesOf } from "../src/features/result/compare";
import { saidBelow } from "../src/features/jobs/timeleft";
import { Forecast } from "../src/features/recording/forecast";
import { distanceOf } from "../src/features/result/distance";
import { Frames } from "../src/features/result/frames";
import { History } from "../src/features/result/history";
import { NextSteps } from "../src/features/result/nextsteps";
import { ParameterTable } from "../src/features/solve/funnel";
import { anglesOf, answerOf, parametersOf } from "../src/features/solve/parameters";
import { Notice } from "../src/ui/notice";
import { ShortcutProvider } from "../src/ui/shortcuts";

function show(inner: ReactNode, client = new QueryClient()) {
  return render(
    <MemoryRouter>
      <QueryClientProvider client={client}>
        <MantineProvider env="test">
          <ShortcutProvider>{inner}</ShortcutProvider>
        </MantineProvider>
      </QueryClientProvider>
    </MemoryRouter>,
  );
}

describe("what to do now", () => {
  // Fails when the reading's routine warning puts a unit's button beside a refusal that speaks of planes.
  it("offers no other unit for a recording in g that was refused for its planes", () => {
    const result = {
      status: "refused",
      observability: { advice: [] },
      quality: { planes: [] },
      messages: [
        {
          level: "warning",
          code: "imu.accelerometer_unit",
          text: "Accelerations on /imu are in g: at rest their norm is 1.00.",
        },
        { level: "error", code: "planes.faulty", text: "the chosen planes do not determine the motion" },
      ],
    };
    show(
      <NextSteps
        recording={{ id: "ab", report: { imu: { accelerometer_unit: "g" } }, read_settings: {} } as never}
        run={{ job: { id: "j", settings: { priors: [] } } } as never}
        result={result as never}
      />,
    );
    expect(screen.queryByText(/Read accelerations/)).toBeNull();
    expect(screen.getByText("Back to the planes")).toBeTruthy();
  });
});

describe("two answers to compare", () => {
  // Fails when one answer is compared with itself; when what was chosen is not what is compared.
  it("are two, of this recording, until another is chosen", () => {
    expect(sidesOf(["b", "a"], "b", null, null)).toEqual({ from: "a", to: "b" });
    expect(sidesOf(["b", "a"], "refused", null, null)).toEqual({ from: "a", to: "b" });
    expect(sidesOf(["a"], "refused", null, null)).toEqual({ from: null, to: "a" });
    expect(sidesOf(["a"], "a", "elsewhere", null)).toEqual({ from: "elsewhere", to: "a" });
    expect(sidesOf(["b", "a"], "refused", "b", null)).toEqual({ from: "b", to: "a" });
    expect(sidesOf(["b", "a"], "b", "a", "a")).toEqual({ from: "b", to: "a" });
    expect(sidesOf([], "refused", null, null)).toBeNull();
  });

  // Fails when another recording's answer stands opposite the only one, unasked.
  it("of which this recording has one wait for a choice", () => {
    const outcome = { kind: "solve", status: "calibrated", translation_m: [0, 0, 0] };
    const job = (id: string) => ({
      id,
      created_at: "2026-01-01T00:00:00Z",
      settings: { method: "full" },
      result: outcome,
    });
    const client = new QueryClient({ defaultOptions: { queries: { staleTime: Infinity, retry: false } } });
    client.setQueryData(keys.recordings, [{ id: "r2", name: "Another rig", latest_job: job("x") }]);
    show(<Compare recording={{ id: "r1" } as never} runs={[{ job: job("a") } as never]} shown="a" />, client);
    expect(screen.getByText(/Choose the answer to compare with/)).toBeTruthy();
    expect(screen.getByLabelText<HTMLSelectElement>("From").value).toBe("");
    expect(screen.queryByText("See both clouds")).toBeNull();
  });
});

describe("what a solve would know", () => {
  // Fails when the time that was followed, standstill included, is called motion.
  it("rests on the time that could be followed", () => {
    const client = new QueryClient({ defaultOptions: { queries: { enabled: false } } });
    const forecast = {
      text: "All seven would be known.",
      parameters: [{ name: "tx", std: 0.001, unit: "m", weak: false }],
      weak: [],
      planes: [],
      covered_s: 8.2,
    };
    show(<Forecast forecast={forecast as never} planes="" said={[]} />, client);
    expect(screen.getByText(/One standard deviation each/).textContent).toBe(
      "One standard deviation each, from 8 s that could be followed.",
    );
  });
});

describe("how far apart the sensors are", () => {
  const unit = [
    [1, 0, 0, 0],
    [0, 1, 0, 0],
    [0, 0, 1, 1.029],
  ];
  const answer = (p: number[], stds: number[]) =>
    ({
      T_imu_lidar: { translation_m: p },
      uncertainty: {
        translation_std_m: stds,
        covariance: Array.from({ length: 7 }, (_, i) =>
          Array.from({ length: 7 }, (_, j) => (i === j && i > 2 && i < 6 ? (stds[i - 3] ?? 0) ** 2 : 0)),
        ),
      },
    }) as never;

  // Fails when what is weak is called unknown; when an axis across a short line is left out; when nothing is ever unknown.
  it("is told with its standard deviation, up to a metre", () => {
    expect(distanceOf(answer([0, 0, 1.029], [0.001, 0.001, 0.025]))?.sigmaM).toBeCloseTo(0.025);
    expect(distanceOf(answer([0, 0, 0.1], [0.4, 0.001, 0.001]))?.sigmaM).toBeCloseTo(0.4);
    expect(distanceOf(answer([0, 0, 1], [0.2, 0, 0.001]))?.sigmaM).toBeCloseTo(0.02);
    expect(distanceOf(answer([0, 0, 0.1], [0.001, 0.001, 1]))).toBeNull();
  });

  // Fails when a number stands there without its sigma, or as a good one.
  it("is marked where it is weak", () => {
    show(<Frames matrix={unit} base="IMU" other="lidar" apart={{ m: 1.029, sigmaM: 0.025 }} weak />);
    expect(screen.getByRole("figure").textContent).toContain("1029 ± 25 mm apart, weak");
  });
});

describe("both clouds of two runs", () => {
  // Fails when another run is called an old extrinsic, or its name is lost on the way through the address.
  it("have the names of the runs", () => {
    const pose = { translation_m: [0.1, 0, 0], quaternion_xyzw: [0, 0, 0, 1] };
    const query = cloudsQuery("b", { T_imu_lidar: pose as never, time_offset_s: 0.001 }, "Run 3; noon, 2nd");
    const wish = { ...readWish(new URLSearchParams(query), 0), show: "both" as const };
    expect(wish.old).toEqual({ ...pose, time_offset_s: 0.001, name: "Run 3; noon, 2nd" });
    show(<ViewBar recordingId="r" wish={wish} change={() => undefined} />);
    expect(screen.getByText("against Run 3; noon, 2nd")).toBeTruthy();
    expect(screen.getByLabelText("Run 3; noon, 2nd")).toBeTruthy();
    expect(screen.queryByText("Old")).toBeNull();
  });
});

describe("the list of runs", () => {
  // Fails when the planes that were used stand for those that were chosen; when what a refused run used, which is none or some
  // on the way, is counted.
  it("counts the planes used, and those that were chosen, where these differ", () => {
    const run = (id: string, status: string, used: number | null, chosen: number) => ({
      job: {
        id,
        state: "done",
        created_at: "2026-01-01T00:00:00Z",
        settings: {
          method: "full",
          estimate_time_offset: true,
          estimate_planes: true,
          random_seed: 0,
          priors: [],
          excluded_spans_s: [],
          bias_model: "spline",
          imu_sampling: "auto",
          lidar_sampling: "auto",
          cloud: "auto",
          lidar: null,
          imu_noise: null,
          points_per_plane_per_scan: null,
          field_of_view_deg: null,
        },
        planes: Array.from({ length: chosen }, () => ({ restricted: false })),
        result: {
          kind: "solve",
          status,
          codes: [],
          planes_used: used,
          translation_std_m: null,
          rotation_std_deg: null,
        },
      },
      from_latest: null,
    });
    const runs = [
      run("d", "refused", 4, 9),
      run("c", "calibrated", 8, 9),
      run("b", "weak", 9, 9),
      run("a", "calibrated", null, 5),
    ];
    show(<History runs={runs as never} shown="d" />);
    const said = screen.getAllByText(/^Run/).map((line) => line.textContent);
    // Sentences elsewhere speak of "run 2".
    expect(said).toEqual([
      "Run 4: full, 9 planes",
      "Run 3: full, 8 planes, 9 chosen",
      "Run 2: full, 9 planes",
      "Run 1: full, 5 planes",
    ]);
  });
});

describe("a notice", () => {
  // Fails when what the terminal prints after a colon stands on the page as it is.
  it("begins with a capital", () => {
    show(<Notice level="warning">the lidar stood still</Notice>);
    expect(screen.getByText("The lidar stood still")).toBeTruthy();
  });
});

describe("an ended run", () => {
  // Fails when "Refused" stands twice; when a verdict loses a word that stands nowhere else.
  it("says its standing once", () => {
    const job = (status: string) => ({ state: "done", result: { kind: "solve", status } }) as never;
    expect(saidBelow(job("refused"), "Refused. The planes do not hold.")).toBe("The planes do not hold.");
    expect(saidBelow(job("calibrated"), "Calibrated. One standard deviation.")).toBe(
      "Calibrated. One standard deviation.",
    );
    expect(saidBelow(null, "")).toBe("");
  });
});

describe("what a round holds", () => {
  const step = {
    euler_xyz_deg: [1, 2, 3],
    rotation_std_deg: [0.01, 0.01, 0.01],
    translation_m: [0.1, 0.2, 0.3],
    translation_std_m: [0.001, null, 0.001],
    time_offset_s: 0.0125,
    time_offset_std_s: 0.0001,
  };

  // Fails when what is held shows a standard deviation, be it nought or none of its own; when one of a solve's end does.
  it("is called held", () => {
    const rows = () => screen.getAllByRole("row").map((row) => row.textContent);
    const view = show(<ParameterTable parameters={parametersOf([step])} angles={null} />);
    expect(rows().filter((text) => text.includes("held"))).toEqual(["Position y200.0heldmm"]);
    expect(rows()[0]).toContain("± 1.0");
    view.unmount();
    const outcome = { ...step, translation_std_m: [0.001, 0.001, 0.001] } as never;
    show(<ParameterTable parameters={parametersOf([step, ...answerOf(outcome, true)])} angles={null} />);
    expect(rows().filter((text) => text.includes("held"))).toEqual(["Time offset12.500heldms"]);
  });

  // Fails when the sigma of a turn about one of the lidar's axes stands beside roll, pitch or yaw: of a lidar on its side the turn
  // about its x is a pitch.
  it("puts no sigma beside roll, pitch and yaw", () => {
    const onItsSide = { ...step, euler_xyz_deg: [90, 0.5, -179.5], rotation_std_deg: [0.09, 0.36, 0.09] };
    const rows = () => screen.getAllByRole("row").map((row) => row.textContent);
    show(<ParameterTable parameters={parametersOf([onItsSide])} angles={anglesOf([onItsSide])} />);
    expect(rows()[3]).toBe("Roll, pitch, yaw90.000  0.500  −179.500°");
    expect(rows()[5]).toBe("About lidar y± 0.36°");
  });
});
