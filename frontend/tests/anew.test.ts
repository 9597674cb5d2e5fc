import { QueryClient, QueryObserver } from "@tanstack/react-query";
import { expect, test } from "vitest";
import { readAnew } from "../src/api/anew";

/** A first answer from before the change that comes after it. Mutation: invalidated without being cancelled. */
test("an answer that was on its way before the change is not the newest", async () => {
  const client = new QueryClient();
  const answers: ((value: string) => void)[] = [];
  const observer = new QueryObserver(client, {
    queryKey: ["recording"],
    queryFn: () => new Promise<string>((resolve) => answers.push(resolve)),
  });
  const leave = observer.subscribe(() => undefined);
  const read = readAnew(client, { queryKey: ["recording"] });
  await new Promise((resolve) => setTimeout(resolve, 10));
  answers[0]?.("0 of 30 bytes");
  answers[1]?.("all of them");
  await read;
  await new Promise((resolve) => setTimeout(resolve, 10));
  expect(client.getQueryData(["recording"])).toBe("all of them");
  leave();
});
