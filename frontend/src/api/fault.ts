/** An error as the server tells it: a stable code and one sentence for a person. */
export class ApiFault extends Error {
  readonly code: string;
  readonly status: number;

  constructor(text: string, code: string, status: number) {
    super(text);
    this.name = "ApiFault";
    this.code = code;
    this.status = status;
  }
}

interface ErrorBody {
  error: { code: string; text: string };
}

function isErrorBody(body: unknown): body is ErrorBody {
  if (typeof body !== "object" || body === null || !("error" in body)) return false;
  const { error } = body;
  return (
    typeof error === "object" &&
    error !== null &&
    "code" in error &&
    "text" in error &&
    typeof error.code === "string" &&
    typeof error.text === "string"
  );
}

/** The fault behind a response body that is not a success. */
export function faultOf(body: unknown, status: number): ApiFault {
  if (isErrorBody(body)) return new ApiFault(body.error.text, body.error.code, status);
  return new ApiFault(
    `The server answered with status ${status} and no explanation; its log says more, then try again.`,
    "http",
    status,
  );
}

/** Whatever was thrown, as a fault. A rejected fetch means that the server cannot be reached. */
export function asFault(error: unknown): ApiFault {
  if (error instanceof ApiFault) return error;
  if (error instanceof TypeError) {
    return new ApiFault(
      "The server cannot be reached; see that `unsweep serve` is still running, then try again.",
      "offline",
      0,
    );
  }
  return new ApiFault(
    error instanceof Error ? error.message : "Something unexpected happened; reload the page.",
    "unknown",
    0,
  );
}
