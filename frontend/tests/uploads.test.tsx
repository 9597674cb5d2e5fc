import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, renderHook } from "@testing-library/react";
import { beforeEach, describe, expect, it, vi } from "vitest";
import { previousOf, UploadProvider, useUploads } from "../src/features/start/uploads";

/** What an upload asks and tells of the page. */
interface Heard {
  chunkSize: number;
  onUploadUrlAvailable: () => void;
  onShouldRetry: (error: { originalResponse: null }) => boolean;
  onError: (error: Error) => void;
}

/** What the browser keeps of uploads, and how often one began. */
const kept = vi.hoisted(() => ({
  find: vi.fn(),
  resumed: vi.fn(),
  started: vi.fn(),
  aborted: vi.fn(),
  options: [] as Heard[],
}));

vi.mock("tus-js-client", () => ({
  Upload: class {
    url = "/api/uploads/ab12";
    constructor(
      _file: File,
      private readonly options: Heard,
    ) {
      kept.options.push(options);
    }
    abort = kept.aborted;
    findPreviousUploads = kept.find;
    resumeFromPreviousUpload = kept.resumed;
    start() {
      kept.started();
      this.options.onUploadUrlAvailable();
    }
  },
}));

beforeEach(() => {
  vi.restoreAllMocks();
  vi.clearAllMocks();
  kept.find.mockResolvedValue([]);
});

async function upload() {
  const { id } = await begun();
  return id;
}

async function begun() {
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
  const options = kept.options.at(-1);
  if (options === undefined) throw new Error("no upload began");
  return { id, result, options };
}

/** The browser loses its network, or has it again. */
function setNetwork(onLine: boolean) {
  vi.spyOn(navigator, "onLine", "get").mockReturnValue(onLine);
  act(() => void window.dispatchEvent(new Event(onLine ? "online" : "offline")));
}

const lost = Object.assign(new Error("lost"), { originalResponse: null });

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

  // Seen: a reload at 23 of 96 MB left nothing, for the server keeps of a request that is cut short only what it has whole. Fails when so
  // much is at stake in one.
  it("loses little when the page is reloaded", async () => {
    const { options } = await begun();
    expect(options.chunkSize).toBeLessThanOrEqual(8 * 2 ** 20);
  });

  // Fails when nothing kept is taken for something.
  it("has nothing before it where the browser keeps nothing", async () => {
    kept.find.mockResolvedValue([]);
    expect(await previousOf({ findPreviousUploads: kept.find })).toBeUndefined();
  });

  // Mutations: a lost network ends it; it is tried again without one, until all tries are used up; it goes on more than once.
  it("waits for a network and goes on when there is one", async () => {
    const { result, options } = await begun();
    for (let times = 1; times <= 3; times += 1) {
      setNetwork(false);
      expect(options.onShouldRetry(lost)).toBe(false);
      act(() => options.onError(lost));
      expect(result.current.list).toMatchObject([{ fault: null, waiting: true }]);
      expect(kept.started).toHaveBeenCalledTimes(times);
      setNetwork(true);
      expect(result.current.list).toMatchObject([{ fault: null, waiting: false }]);
      setNetwork(true);
      expect(kept.started).toHaveBeenCalledTimes(times + 1);
    }
    expect(options.onShouldRetry(lost)).toBe(true);
  });

  // Mutation: what was cancelled while it waited begins anew with the network.
  it("does not go on after it was cancelled", async () => {
    const { id, result, options } = await begun();
    setNetwork(false);
    act(() => options.onError(lost));
    act(() => result.current.cancel(id));
    setNetwork(true);
    expect(result.current.list).toEqual([]);
    expect([kept.aborted.mock.calls.length, kept.started.mock.calls.length]).toEqual([1, 1]);
  });

  // Mutation: a server's refusal waited for as if it were a lost network.
  it("ends where the server refuses it", async () => {
    const { result, options } = await begun();
    setNetwork(true);
    act(() => options.onError(lost));
    expect(result.current.list).toMatchObject([{ waiting: false, fault: { code: "unknown" } }]);
  });
});
