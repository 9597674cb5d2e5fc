import { localStorageColorSchemeManager, MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { BrowserRouter } from "react-router";
import { ApiFault } from "./api/fault";
import { App } from "./app";
import { UploadProvider } from "./features/start/uploads";
import "./mantine";
import "./styles.css";
import { cssVariables, theme } from "./theme";
import { ShortcutProvider } from "./ui/shortcuts";

const queries = new QueryClient({
  defaultOptions: {
    queries: {
      // An answer that says no will say no again; only a server that cannot be reached is worth asking twice.
      retry: (failures, error) => failures < 2 && !(error instanceof ApiFault && error.status < 500),
      staleTime: 5_000,
    },
  },
});

const root = document.getElementById("root");
if (root === null) throw new Error("index.html has no element with the id root");
createRoot(root).render(
  <StrictMode>
    <MantineProvider
      theme={theme}
      cssVariablesResolver={cssVariables}
      deduplicateCssVariables={false}
      defaultColorScheme="auto"
      colorSchemeManager={localStorageColorSchemeManager({ key: "unsweep-color-scheme" })}
    >
      <QueryClientProvider client={queries}>
        <ShortcutProvider>
          <UploadProvider>
            <BrowserRouter>
              <App />
            </BrowserRouter>
          </UploadProvider>
        </ShortcutProvider>
      </QueryClientProvider>
    </MantineProvider>
  </StrictMode>,
);
