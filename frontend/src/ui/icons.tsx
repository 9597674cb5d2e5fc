import type { ReactNode } from "react";

export type Tone = "info" | "good" | "warning" | "error";

interface IconProps {
  size?: number;
  color?: string;
}

function Stroke({ size = 18, color = "currentColor", children }: IconProps & { children: ReactNode }) {
  return (
    <svg
      width={size}
      height={size}
      viewBox="0 0 20 20"
      fill="none"
      stroke={color}
      strokeWidth={1.6}
      strokeLinecap="round"
      strokeLinejoin="round"
      aria-hidden="true"
      focusable="false"
    >
      {children}
    </svg>
  );
}

const toneColor: Record<Tone, string> = {
  info: "var(--ink-3)",
  good: "var(--good)",
  warning: "var(--warn)",
  error: "var(--bad)",
};

/** Shape as well as colour says how grave it is. */
export function LevelIcon({ level, size = 18 }: { level: Tone; size?: number }) {
  const color = toneColor[level];
  switch (level) {
    case "good":
      return (
        <Stroke size={size} color={color}>
          <circle cx="10" cy="10" r="7.2" />
          <path d="M6.8 10.2l2.3 2.3 4.2-4.8" />
        </Stroke>
      );
    case "warning":
      return (
        <Stroke size={size} color={color}>
          <path d="M10 3.2l7.4 13H2.6z" />
          <path d="M10 8.2v3.6M10 14v.1" />
        </Stroke>
      );
    case "error":
      return (
        <Stroke size={size} color={color}>
          <path d="M6.8 2.8h6.4l4 4v6.4l-4 4H6.8l-4-4V6.8z" />
          <path d="M7.7 7.7l4.6 4.6M12.3 7.7l-4.6 4.6" />
        </Stroke>
      );
    case "info":
      return (
        <Stroke size={size} color={color}>
          <circle cx="10" cy="10" r="7.2" />
          <path d="M10 9.2v4.3M10 6.6v.1" />
        </Stroke>
      );
  }
}

const paths = {
  sun: "M10 6.4a3.6 3.6 0 100 7.2 3.6 3.6 0 000-7.2M10 2v1.6M10 16.4V18M2 10h1.6M16.4 10H18M4.3 4.3l1.2 1.2M14.5 14.5l1.2 1.2M4.3 15.7l1.2-1.2M14.5 5.5l1.2-1.2",
  moon: "M16.5 11.8A6.8 6.8 0 118.2 3.5a5.4 5.4 0 008.3 8.3z",
  undo: "M7.5 4L4 7.5 7.5 11M4.3 7.5h7.4a4.2 4.2 0 010 8.4H8",
  redo: "M12.5 4L16 7.5 12.5 11M15.7 7.5H8.3a4.2 4.2 0 000 8.4H12",
  play: "M6.5 4.2v11.6l9-5.8z",
  pause: "M7 4.5v11M13 4.5v11",
  previous: "M12.5 4.5L7 10l5.5 5.5",
  next: "M7.5 4.5L13 10l-5.5 5.5",
  folder:
    "M2.8 5.2c0-.7.5-1.2 1.2-1.2h3.4l1.8 2h6.8c.7 0 1.2.5 1.2 1.2v7.6c0 .7-.5 1.2-1.2 1.2H4c-.7 0-1.2-.5-1.2-1.2z",
  file: "M5 2.8h6.2L15 6.6v10.6H5zM11 3v3.8h3.8",
  download: "M10 3.2v9M6.4 8.8L10 12.4l3.6-3.6M3.6 16.4h12.8",
  upload: "M10 12.6V3.4M6.4 7L10 3.4 13.6 7M3.6 16.4h12.8",
  copy: "M7 7V3.6h9.4V13H13M3.6 7H13v9.4H3.6z",
  check: "M4 10.6l4 4 8-9",
  cross: "M5 5l10 10M15 5L5 15",
  trash: "M3.8 5.6h12.4M8 5.4V3.4h4v2M5.4 5.8l.7 10.8h7.8l.7-10.8",
  pencil: "M4 16l.8-3.6 8.6-8.6 2.8 2.8-8.6 8.6zM11.6 5.6l2.8 2.8",
  merge: "M4 4.5c5 0 5 5.5 10 5.5M4 15.5c5 0 5-5.5 10-5.5M13 7l3 3-3 3",
  grow: "M10 3v14M3 10h14",
  more: "M4.5 10h.1M10 10h.1M15.5 10h.1",
  sample: "M3 13c2.4 0 2.4-6 4.7-6s2.3 6 4.6 6S14.700 7 17 7",
  server: "M3.6 4h12.8v4.6H3.6zM3.6 11.400h12.8V16H3.6zM6.4 6.300h.1M6.400 13.700h.1",
  box: "M3.2 5.800V3.200h2.600M14.200 3.200h2.600v2.600M16.800 14.200v2.600h-2.600M5.800 16.800H3.200v-2.600M7 10h6M10 7v6",
  help: "M7.400 7.600a2.700 2.700 0 115 1.300c-.9.900-2.400 1.300-2.400 3M10 14.800v.1",
  restart: "M15.8 6.4A6.8 6.8 0 1016.800 10M16 3v3.600h-3.600",
} as const;

export type IconName = keyof typeof paths;

export function Icon({ name, size = 16 }: { name: IconName; size?: number }) {
  return (
    <Stroke size={size}>
      <path d={paths[name]} />
    </Stroke>
  );
}
