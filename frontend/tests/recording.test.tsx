import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { render, screen } from "@testing-library/react";
import { describe, expect, it, vi } from "vitest";
import type { DoctorReport, Recording } from "../src/api/client";
import { Report, settledFindings } from "../src/features/recording/report";
import { isNoRecording } from "../src/features/recording/screen";
import { openChoices, Sensors } from "../src/features/recording/sensors";

// Plots want a canvas, which jsdom has none of.
vi.mock("../src/ui/lineplot", () => ({ LinePlot: () => null }));

const whole: DoctorReport = {
  schema: "unsweep.report/1",
  name: "room.bag",
  size_bytes: 9,
  container: "ros1",
  duration_s: 12,
  start_ns: 0,
  topics: [{ name: "/points", type: "sensor_msgs/msg/PointCloud2", messages: 120, rate_hz: 10, role: "lidar" }],
  lidar_candidates: ["/points"],
  imu_candidates: [],
  lidar: null,
  imu: null,
  clock_offset_s: 0,
  timeline: {
    t_s: [],
    rotation_deg_s: [[], [], []],
    rotation_norm_deg_s: [],
    acceleration_m_s2: [[], [], []],
    scan_t_s: [],
  },
  findings: [
    { code: "a", level: "info", text: "Times in seconds.", evidence: [], confidence: 1, consequence: "", override: "" },
  ],
  verdict: "good",
  reasons: ["It is fine."],
  advice: ["Turn more."],
  final: true,
};

function show(report: DoctorReport) {
  const recording: Recording = {
    id: "1",
    name: "room.bag",
    note: "",
    size_bytes: 9,
    received_bytes: 9,
    origin: "upload",
    state: report.final ? "ready" : "inspecting",
    read_settings: {
      stamps: "header",
      imu_bundles: "spread",
      repeated_returns: "once",
      synthesise_point_time: false,
      points_at_once: false,
      range_min_m: 0.3,
      range_max_m: 200,
    },
    report,
    has_planes: false,
    created_at: "2026-01-01T00:00:00Z",
  };
  render(
    <QueryClientProvider client={new QueryClient()}>
      <MantineProvider env="test">
        <Report recording={recording} report={report} planes={undefined}>
          <p>Reading it</p>
        </Report>
        <Sensors recording={recording} />
      </MantineProvider>
    </QueryClientProvider>,
  );
}

describe("a report on the way", () => {
  // Fails when what is not final is shown with its verdict or its advice, or when it waits for them.
  it("shows what was found, the topics, and no verdict yet", () => {
    show({ ...whole, final: false });
    expect(screen.getByText("Reading it")).toBeTruthy();
    expect(screen.getByText("Times in seconds.")).toBeTruthy();
    expect(screen.getAllByText("/points").length).toBe(2);
    expect(screen.queryByText("Good to calibrate")).toBeNull();
    expect(screen.queryByText("Turn more.")).toBeNull();
  });

  // Fails when the end still shows the progress.
  it("ends with the verdict in its place", () => {
    show(whole);
    expect(screen.queryByText("Reading it")).toBeNull();
    expect(screen.getByText("Good to calibrate")).toBeTruthy();
    expect(screen.getByText("Turn more.")).toBeTruthy();
  });
});

describe("several sensors that fit", () => {
  const two = { ...whole, verdict: "limited" as const, lidar_candidates: ["/front", "/rear"] };

  // Seen: a sentence that named a choice by a word that stood nowhere. Fails when the verdict offers no topic, or the list has no
  // visible name.
  it("are offered where the verdict asks for one, and the list is called what it is", () => {
    show(two);
    expect(screen.getByRole("button", { name: "Use the lidar /front" })).toBeTruthy();
    expect(screen.getByRole("button", { name: "Use the lidar /rear" })).toBeTruthy();
    expect(screen.getByText("Lidar topic")).toBeTruthy();
  });

  // Fails when they are offered before everything was looked at, or of one that fits alone.
  it("are none before the end, and none of one", () => {
    expect(openChoices({ ...two, final: false })).toEqual([]);
    expect(openChoices(whole)).toEqual([]);
    expect(openChoices(two).map((choice) => choice.change)).toEqual([
      { lidar_topic: "/front" },
      { lidar_topic: "/rear" },
    ]);
  });
});

// Seen: of a text file that was called .bag, a form was offered with the units of its gyroscope. Fails when any refusal is taken for
// that, or one of a file whose topics were read.
it("knows a file that is no recording from one that is read wrongly", () => {
  const error = { code: "recording.unreadable", text: "", details: null };
  expect(isNoRecording({ error, report: null })).toBe(true);
  expect(isNoRecording({ error, report: whole })).toBe(false);
  expect(isNoRecording({ error: { ...error, code: "recording.topic" }, report: null })).toBe(false);
  expect(isNoRecording({ error: null, report: null })).toBe(false);
});

// Seen: of two lidars, with none chosen, "25 % sure" of rad/s, and a button that makes it wrong. Fails when a guess that the lidar will
// settle is shown; when what is sure is not; when it is hidden for good.
it("asks for no unit that the lidar will tell once it is chosen", () => {
  const [recognised] = whole.findings.map((one) => ({ ...one, code: "imu.gyroscope_unit", confidence: 0.25 }));
  const finding = recognised as DoctorReport["findings"][number];
  const told = { lidar: null, lidar_candidates: ["/a", "/b"], findings: [finding] };
  expect(settledFindings(told)).toEqual([]);
  expect(settledFindings({ ...told, findings: [{ ...finding, confidence: 1 }] })).toHaveLength(1);
  expect(settledFindings({ ...told, lidar_candidates: ["/a"] })).toHaveLength(1);
  expect(settledFindings({ ...told, lidar: {} as never })).toHaveLength(1);
});
