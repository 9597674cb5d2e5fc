import { act, renderHook } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { useStraightening } from "../src/features/solve/straightening";

interface Seen {
  job: string | null;
  answered: boolean | null;
}

beforeEach(() => {
  vi.useFakeTimers();
});

afterEach(() => {
  vi.useRealTimers();
  vi.restoreAllMocks();
});

/** The screen of a run, and every straightness that it asked the scene for. */
function look(first: Seen) {
  const shown: number[] = [];
  const changeView = (change: { straight: number }) => void shown.push(change.straight);
  const { rerender, unmount } = renderHook(({ job, answered }: Seen) => useStraightening(job, answered, changeView), {
    initialProps: first,
  });
  const wait = (ms: number) => act(() => void vi.advanceTimersByTime(ms));
  return { shown, wait, unmount, then: (job: string, answered: boolean | null) => rerender({ job, answered }) };
}

/** How often the cloud was made raw. */
const raws = (shown: readonly number[]) => shown.filter((straight) => straight === 0).length;

describe("a solve that ends while one looks", () => {
  // Fails when the cloud is not made raw first; when it goes on for ever; when it is shown again at each of the run's last words.
  it("takes the cloud from raw to straight, exactly once", () => {
    const { shown, wait, then } = look({ job: "a", answered: null });
    then("a", false);
    wait(10_000);
    expect(shown).toEqual([]);
    then("a", true);
    wait(10_000);
    expect(shown[0]).toBe(0);
    expect(shown.at(-1)).toBe(1);
    expect(shown).toEqual([...shown].sort((a, b) => a - b));
    expect(new Set(shown).size).toBe(shown.length);
    const once = [...shown];
    then("a", null); // read again, as after a lost connection
    then("a", true);
    wait(10_000);
    expect(shown).toEqual(once);
  });

  // Fails when it is the next run's turn no more.
  it("does so once for each run", () => {
    const { shown, wait, then } = look({ job: "a", answered: false });
    then("a", true);
    wait(10_000);
    then("b", false);
    then("b", true);
    wait(10_000);
    expect(raws(shown)).toBe(2);
  });

  // Fails when half a straightening is left behind.
  it("leaves the cloud straight where one goes away meanwhile", () => {
    const { shown, wait, then, unmount } = look({ job: "a", answered: false });
    then("a", true);
    wait(500);
    expect(shown.at(-1)).toBeLessThan(1);
    unmount();
    expect(shown.at(-1)).toBe(1);
  });
});

describe("a solve that had ended before one looked", () => {
  // Fails when every visit shows it.
  it("is straight at once", () => {
    const { shown, wait, then } = look({ job: "a", answered: null });
    then("a", true);
    wait(10_000);
    expect(shown).toEqual([]);
  });

  // Fails when any run that was watched will do.
  it("is so although another is still running", () => {
    const { shown, wait, then } = look({ job: "a", answered: false });
    then("b", true);
    wait(10_000);
    expect(shown).toEqual([]);
  });
});

describe("a person who asked for no motion", () => {
  // Fails when the wish is not asked for.
  it("gets the straight cloud", () => {
    vi.spyOn(window, "matchMedia").mockReturnValue({ matches: true } as MediaQueryList);
    const { shown, wait, then } = look({ job: "a", answered: false });
    then("a", true);
    wait(10_000);
    expect(shown).toEqual([]);
  });
});
