import react from "@vitejs/plugin-react";
import { defineConfig } from "vitest/config";

// `npm run dev` serves the client with live reload in front of a running `unsweep serve`.
const server = process.env["UNSWEEP_SERVER"] ?? "http://127.0.0.1:8080";

export default defineConfig({
  plugins: [react()],
  build: {
    outDir: "../app/static",
    emptyOutDir: true,
    assetsInlineLimit: 0,
    license: { fileName: "third-party-licenses.md" },
  },
  server: {
    proxy: {
      "/api": { target: server, changeOrigin: true },
      "/scene": { target: server, ws: true, changeOrigin: true },
    },
  },
  test: {
    environment: "jsdom",
    // A file's world is a context of its own in a thread, not a process that loads everything anew: a quarter of the time.
    pool: "vmThreads",
    include: ["tests/**/*.test.{ts,tsx}"],
    setupFiles: ["tests/setup.ts"],
    // A machine with other work takes five times as long: no test is about time.
    testTimeout: 60_000,
    hookTimeout: 60_000,
  },
});
