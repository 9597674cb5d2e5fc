import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { render, screen } from "@testing-library/react";
import type { ReactNode } from "react";
import { MemoryRouter } from "react-router";
import { describe, expect, it } from "vitest";
import { NextSteps } from "../src/features/result/nextsteps";

function show(inner: ReactNode, client = new QueryClient()) {
  return render(
    <MemoryRouter>
      <QueryClientProvider client={client}>
        <MantineProvider>{inner}</MantineProvider>
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
      messages: [
        {
          level: "warning",
          code: "imu.accelerometer_unit",
          text: "Accelerations on /imu are in g: at rest their norm is 1.00.",
        },
        { level: "error", code: "planes.faulty", text: "the planes chosen do not hold the motion" },
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
