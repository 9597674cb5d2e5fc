import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, renderHook } from "@testing-library/react";
import { describe, expect, it } from "vitest";
import { keys } from "../src/api/queries";
import { useReturns } from "../src/features/workspace/returns";

describe("a tab that is come back to", () => {
  const returnsOf = (shown: string, mode: "planes" | "inspect" | null) => {
    const client = new QueryClient();
    client.setQueryData(keys.view("ab12"), { mode: shown });
    const { result } = renderHook(() => useReturns("ab12", mode), {
      wrapper: ({ children }) => <QueryClientProvider client={client}>{children}</QueryClientProvider>,
    });
    act(() => void window.dispatchEvent(new Event("focus")));
    return result.current[0];
  };

  // Fails when a tab leaves the scene as another one had it; when each return has the scene made anew.
  it("tells the scene its screen where another tab has changed it", () => {
    expect(returnsOf("planes", "inspect")).toBe(1);
    expect(returnsOf("inspect", "inspect")).toBe(0);
    expect(returnsOf("planes", null)).toBe(0);
  });
});
