import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, renderHook } from "@testing-library/react";
import { afterEach, describe, expect, it, vi } from "vitest";
import { useRecordingFeed } from "../src/api/feed";

/** The browser's own, driven by hand. */
class Source {
  static last: Source;
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
    expect(refreshed).toHaveBeenCalledOnce();
    act(() => Source.last.onopen());
    expect(result.current).toBe(false);
    expect(refreshed).toHaveBeenCalledTimes(2);
  });

  // Fails when only what is missed by a break is asked for: a job that ended before the first message stayed "starting" for ever.
  it("asks again once it is there, for what happened since the page looked", () => {
    const { refreshed } = follow();
    expect(refreshed).not.toHaveBeenCalled();
    act(() => Source.last.onopen());
    expect(refreshed).toHaveBeenCalledWith({ queryKey: ["recording", "ab12"] });
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
