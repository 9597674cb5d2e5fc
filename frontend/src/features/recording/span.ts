export interface Span {
  startS: number;
  endS: number;
}

/** A span after one of its ends was moved: within the recording, and never shorter than what a solve can use. */
export function moved(span: Span, end: "start" | "end", toS: number, durationS: number, shortestS: number): Span {
  const least = Math.min(shortestS, durationS);
  switch (end) {
    case "start":
      return { ...span, startS: Math.max(0, Math.min(toS, span.endS - least)) };
    case "end":
      return { ...span, endS: Math.min(durationS, Math.max(toS, span.startS + least)) };
  }
}

/** The span between two points of a drag, whichever came first. */
export function dragged(fromS: number, toS: number, durationS: number, shortestS: number): Span {
  const least = Math.min(shortestS, durationS);
  const startS = Math.max(0, Math.min(fromS, toS, durationS - least));
  return { startS, endS: Math.min(durationS, Math.max(fromS, toS, startS + least)) };
}
