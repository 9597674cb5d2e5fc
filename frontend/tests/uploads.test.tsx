import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, renderHook } from "@testing-library/react";
import { beforeEach, describe, expect, it, vi } from "vitest";
import { previousOf, UploadProvider, useUploads } from "../src/features/start/uploads";

/** What the browser keeps of uploads, and how often one began. */
const kept = vi.hoisted(() => ({ find: vi.fn(), resumed: vi.fn(), started: vi.fn() }));

vi.mock("tus-js-client", () => ({
  Upload: class {
    url = "/api/uploads/ab12";
    constructor(
      _file: File,
      private readonly options: { onUploadUrlAvailable: () => void },
    ) {}
    findPreviousUploads = kept.find;
    resumeFromPreviousUpload = kept.resumed;
    start() {
      kept.started();
      this.options.onUploadUrlAvailable();
    }
  },
}));

beforeEach(() => void vi.clearAllMocks());

async function upload() {
  const { result } = renderHook(() => useUploads(), {
    wrapper: ({ children }) => (
      <QueryClientProvider client={new QueryClient()}>
        <UploadProvider>{children}</UploadProvider>
      </QueryClientProvider>
    ),
  });
  let id = "";
  await act(async () => {
    id = await result.current.start(new File(["x"], "room.bag"));
  });
  return id;
}

describe("an upload", () => {
  // Fails when a look-up that is refused is waited for: the upload would never begin, and nobody would be told.
  it("begins anew where the browser forbids the look-up", async () => {
    kept.find.mockRejectedValue(new Error("forbidden"));
    expect(await upload()).toBe("ab12");
    expect(kept.started).toHaveBeenCalledOnce();
    expect(kept.resumed).not.toHaveBeenCalled();
  });

  // Fails when what was begun before is looked up and not used.
  it("goes on where it was interrupted", async () => {
    const before = { size: 1, uploadUrl: "/api/uploads/ab12" };
    kept.find.mockResolvedValue([before]);
    expect(await upload()).toBe("ab12");
    expect(kept.resumed).toHaveBeenCalledWith(before);
  });

  // Fails when nothing kept is taken for something.
  it("has nothing before it where the browser keeps nothing", async () => {
    kept.find.mockResolvedValue([]);
    expect(await previousOf({ findPreviousUploads: kept.find })).toBeUndefined();
  });
});
