import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { render, screen } from "@testing-library/react";
import { describe, expect, it, vi } from "vitest";
import type { DoctorReport, Recording } from "../src/api/client";
import { Report } from "../src/features/recording/report";
import { Sensors } from "../src/features/recording/sensors";

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
