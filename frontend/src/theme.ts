import { createTheme, type CSSVariablesResolver, type MantineColorsTuple } from "@mantine/core";

const signal: MantineColorsTuple = [
  "#eaf2ff",
  "#d3e3ff",
  "#a8c7ff",
  "#7fadff",
  "#5c97fb",
  "#3f82ee",
  "#2b6edb",
  "#1f5cbf",
  "#174a9c",
  "#0f3878",
];

/** Neutral greys with a trace of blue: colours in the 3D scene must not be tinted by what surrounds them. */
const dark: MantineColorsTuple = [
  "#e7eaee",
  "#c4cbd4",
  "#a3adb9",
  "#8792a0",
  "#4a535e",
  "#363d46",
  "#2a3038",
  "#1c2026",
  "#15181d",
  "#0f1215",
];

export const theme = createTheme({
  primaryColor: "signal",
  primaryShade: { light: 7, dark: 6 },
  colors: { signal, dark },
  fontFamily: '"IBM Plex Sans", system-ui, sans-serif',
  fontFamilyMonospace: '"IBM Plex Mono", ui-monospace, monospace',
  headings: { fontFamily: '"IBM Plex Sans", system-ui, sans-serif', fontWeight: "600" },
  fontSizes: { xs: "0.75rem", sm: "0.8125rem", md: "0.875rem", lg: "1rem", xl: "1.1875rem" },
  defaultRadius: "sm",
  radius: { sm: "5px", md: "8px" },
  cursorType: "pointer",
  focusRing: "auto",
  respectReducedMotion: true,
});

export const cssVariables: CSSVariablesResolver = () => ({
  variables: {},
  light: {
    "--mantine-color-body": "var(--surface-0)",
    "--mantine-color-text": "var(--ink-1)",
    "--mantine-color-dimmed": "var(--ink-2)",
    "--mantine-color-placeholder": "var(--ink-3)",
    "--mantine-color-default": "var(--surface-1)",
    "--mantine-color-default-hover": "var(--surface-3)",
    "--mantine-color-default-border": "var(--line-strong)",
    "--mantine-color-default-color": "var(--ink-1)",
    "--mantine-color-error": "var(--bad)",
  },
  dark: {
    "--mantine-color-body": "var(--surface-0)",
    "--mantine-color-text": "var(--ink-1)",
    "--mantine-color-dimmed": "var(--ink-2)",
    "--mantine-color-placeholder": "var(--ink-3)",
    "--mantine-color-default": "var(--surface-2)",
    "--mantine-color-default-hover": "var(--surface-3)",
    "--mantine-color-default-border": "var(--line-strong)",
    "--mantine-color-default-color": "var(--ink-1)",
    "--mantine-color-error": "var(--bad)",
  },
});
