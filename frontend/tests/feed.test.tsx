import { QueryClient, QueryClientProvider, QueryObserver } from "@tanstack/react-query";
import { act, renderHook } from "@testing-library/react";
import { afterEach, describe, expect, it, vi } from "vitest";
import { useRecordingFeed } from "../src/api/feed";

/** The browser's own, driven by hand. */
class Source {
  static last: Source;
  onmessage: (event: { data: string }) => void = () => undefined;
  onopen: () => void = () => undefined;
  onerror: () => void = () => undefined;
  constructor() {
    Source.last = this;
  }
  close() {}
}

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

function follow() {
  vi.stubGlobal("EventSource", Source);
  vi.useFakeTimers();
  const client = new QueryClient();
  const refreshed = vi.spyOn(client, "invalidateQueries");
  const { result } = renderHook(() => useRecordingFeed("ab12"), {
    wrapper: ({ children }) => <QueryClientProvider client={client}>{children}</QueryClientProvider>,
  });
  return { result, refreshed };
}

describe("a feed whose server goes away", () => {
  // Fails when a broken connection is not told, or is told for ever; when what was missed meanwhile is not asked for.
  it("is lost until it is back, and then everything is asked for again", () => {
    const { result, refreshed } = follow();
    act(() => Source.last.onopen());
    act(() => Source.last.onerror());
    act(() => void vi.advanceTimersByTime(1000));
    act(() => Source.last.onerror());
    expect(result.current).toBe(false);
    act(() => void vi.advanceTimersByTime(1000));
    expect(result.current).toBe(true);
    const before = refreshed.mock.calls.length;
    act(() => Source.last.onopen());
    expect(result.current).toBe(false);
    expect(refreshed.mock.calls.length).toBeGreaterThan(before);
  });

  // Fails when only what is missed by a break is asked for: a job that ended before the first message stayed "starting" for ever.
  it("asks again once it is there, for what happened since the page looked", async () => {
    const { refreshed } = follow();
    expect(refreshed).not.toHaveBeenCalled();
    act(() => Source.last.onopen());
    await vi.advanceTimersByTimeAsync(1);
    expect(refreshed).toHaveBeenCalledWith({ queryKey: ["recording", "ab12"], exact: true });
  });

  // Fails when a moment's break is told.
  it("is not told of when it comes back at once", () => {
    const { result } = follow();
    act(() => Source.last.onerror());
    act(() => Source.last.onopen());
    act(() => void vi.advanceTimersByTime(10_000));
    expect(result.current).toBe(false);
  });
});

describe("a recording that is read anew", () => {
  // Mutation: each message cuts the reading before it short, which then goes on with what was known before.
  it("is not asked for planes that it had before", async () => {
    vi.stubGlobal("EventSource", Source);
    const client = new QueryClient();
    const answers: ((value: { has_planes: boolean }) => void)[] = [];
    const readPlanes = vi.fn(() => Promise.resolve({ revision: 2 }));
    client.setQueryData(["recording", "ab12"], { has_planes: true });
    client.setQueryData(["recording", "ab12", "planes"], { revision: 1 });
    const common = { staleTime: Infinity };
    const recording = new QueryObserver(client, {
      ...common,
      queryKey: ["recording", "ab12"],
      queryFn: () => new Promise<{ has_planes: boolean }>((resolve) => answers.push(resolve)),
    });
    const planes = new QueryObserver(client, {
      ...common,
      queryKey: ["recording", "ab12", "planes"],
      queryFn: readPlanes,
    });
    const leave = [recording.subscribe(() => undefined), planes.subscribe(() => undefined)];
    renderHook(() => useRecordingFeed("ab12"), {
      wrapper: ({ children }) => <QueryClientProvider client={client}>{children}</QueryClientProvider>,
    });
    const say = (event: object) => Source.last.onmessage({ data: JSON.stringify(event) });
    const settled = () => new Promise((resolve) => setTimeout(resolve, 10));
    for (let message = 0; message < 3; message++) {
      act(() => say({ event: "job-changed", job: { kind: "planes", state: "running" } }));
      await settled();
    }
    expect(readPlanes).not.toHaveBeenCalled();
    answers[0]?.({ has_planes: true });
    await settled();
    // One reading for all that was asked for meanwhile, and only then the planes, of which there are none.
    expect(answers).toHaveLength(2);
    answers[1]?.({ has_planes: false });
    await settled();
    expect(readPlanes).not.toHaveBeenCalled();
    act(() => say({ event: "job-changed", job: { kind: "planes", state: "done" } }));
    await settled();
    answers[2]?.({ has_planes: true });
    await settled();
    expect(readPlanes).toHaveBeenCalledOnce();
    for (const go of leave) go();
  });
});
