/** The page's own words for what other programs of this kind say in options and field paths.
 *
 *  The server's sentences also serve the command line, where the cure is an option. Here the cure is a control, so every
 *  sentence that comes in is put into the page's words once, at the border; nothing behind it knows options.
 */

/** What each option is called on the page. */
const controls: Readonly<Record<string, string>> = {
  "lidar-topic": "Lidar topic",
  "imu-topic": "IMU topic",
  "start-s": "Start of the span",
  "end-s": "End of the span",
  "range-min-m": "Nearest range",
  "range-max-m": "Farthest range",
  "point-time-field": "Point time field",
  "point-time-unit": "Point time unit",
  "point-time-reference": "Point time counts from",
  "synthesise-point-time": "Make up point times",
  "points-at-once": "All points at once",
  "accelerometer-unit": "Accelerometer unit",
  "gyroscope-unit": "Gyroscope unit",
  stamps: "Stamps",
  "imu-bundles": "IMU stamped in bundles or sent again",
  "repeated-returns": "Returns that are there twice",
  method: "Method",
  "points-per-plane-per-scan": "Points per plane and scan",
  "field-of-view-deg": "Field of view",
  planes: "Planes",
  "initial-guess": "Start value",
  gravity: "Gravity",
  "imu-noise": "IMU noise",
  prior: "What is known",
  exclude: "Leave out",
  "fix-time-offset": "Estimate the time offset",
  "fix-planes": "Estimate the planes",
  "bias-model": "Biases",
  "imu-sampling": "IMU sampling",
  "lidar-sampling": "Lidar sampling",
  "random-seed": "Random seed",
  "max-rounds": "Most rounds",
  intrinsics: "Sensors' own errors",
  lidar: "Lidar",
};

/** Values as people write them. */
const values: Readonly<Record<string, string>> = {
  rad_s: "rad/s",
  deg_s: "°/s",
  m_s2: "m/s²",
  full: "Full",
  paper: "As published",
  "header-first": "the header, first point",
  "header-last": "the header, last point",
  receive: "time of arrival",
  header: "header",
  spread: "a period apart",
  "as-stamped": "as stamped",
  "as-sent": "as sent",
  once: "counted once",
};
const plainValues = new Set([
  "s",
  "ms",
  "us",
  "ns",
  "g",
  "absolute",
  "constant",
  "random-walk",
  "auto",
  "consider",
  "off",
  "even",
  "as-stamped",
  "detect",
]);

const switches = new Set(["synthesise-point-time", "points-at-once"]);

export function controlName(option: string): string {
  return controls[option] ?? option.replaceAll("-", " ");
}

export function valueName(value: string): string {
  return values[value] ?? value;
}

/** One sentence in the page's words: options become controls, paths of fields the names of what they are. */
export function plain(text: string): string {
  return text
    .replace(/The request does not fit the API's document: /, "That cannot be used: ")
    .replace(/\b(?:body|query|path)(?:\.[a-z0-9_]+)+/g, (path) => fieldName(path))
    .replace(/`unsweep inspect`/g, "the Recording screen")
    .replace(/`unsweep calibrate --help`/g, "the list in Solve")
    .replace(
      /(\b(?:pass|use|give|set|with|leave)\s+)?`?--([a-z][a-z0-9-]*)`?(?:[ =]`?([a-z0-9_-]+)`?)?/g,
      (_, verb: string | undefined, option: string, next: string | undefined) => {
        const known = next !== undefined && (next in values || plainValues.has(next));
        const name = controlName(option);
        if (known) return verb === undefined ? `“${name}: ${valueName(next)}”` : `set “${name}” to ${valueName(next)}`;
        const doing =
          verb !== undefined && switches.has(option) ? "switch on " : verb === "pass " ? "set " : (verb ?? "");
        return `${doing}“${name}”${next === undefined ? "" : ` ${next}`}`;
      },
    )
    .replace(/ \+- /g, " ± ")
    .replace(/\bm\/s2\b/g, "m/s²")
    .replace(/\b(rad_s|deg_s|m_s2)\b/g, (unit) => valueName(unit));
}

/** The last word of a field's path that says something: `body.settings.priors.0.std` is "priors, 1st: std". */
function fieldName(path: string): string {
  const parts = path
    .split(".")
    .slice(1)
    .filter((part) => part !== "settings");
  const words = parts.map((part) =>
    /^\d+$/.test(part) ? `number ${Number(part) + 1}` : part.replaceAll("_", " ").replace(/ (deg|m|s|m s2|rad s)$/, ""),
  );
  return words.length === 0 ? "it" : words.join(", ");
}

/** What other programs print after a colon begins small; where it stands for itself it is a sentence. */
export function sentenceCase(text: string): string {
  return `${text.charAt(0).toUpperCase()}${text.slice(1)}`;
}

/** A number of planes. */
export function planesOf(count: number): string {
  return count === 1 ? "1 plane" : `${count} planes`;
}

const sentences = new Set(["text", "verdict", "consequence", "reason", "state_text", "note", "noise_text"]);
const lists = new Set(["reasons", "advice", "notes", "hints"]);

/** An answer of the server with every sentence in it in the page's words. */
export function spoken<T>(answer: T): T {
  return walk(answer) as T;
}

function walk(value: unknown, key = ""): unknown {
  if (typeof value === "string") return sentences.has(key) || lists.has(key) ? plain(value) : value;
  if (Array.isArray(value)) {
    // Readings and outlines hold thousands of numbers and not one sentence.
    return typeof value[0] === "number" ? value : value.map((item: unknown) => walk(item, key));
  }
  if (typeof value !== "object" || value === null) return value;
  return Object.fromEntries(Object.entries(value).map(([name, item]) => [name, walk(item, name)]));
}
