import type { Job, Usual } from "../../api/client";
import { axes, unitOf } from "../../ui/axes";
import { numberOf } from "../../ui/format";
import { gravityAt, latitudeOf, priorOf, priorText, type Prior, type PriorText, type Settings } from "./priors";

type Served = Job["settings"];

/** What a person has chosen so far, numbers as they are typed. */
export interface Draft {
  method: "full" | "paper";
  points: string;
  fieldDeg: string;
  timeOffset: boolean;
  planes: boolean;
  priors: PriorText[];
  gravity: string;
  gravityNumber: string;
  imuNoise: string;
  biasModel: string;
  imuSampling: string;
  lidarSampling: string;
  intrinsics: string;
  lidar: string;
  seed: string;
  rounds: string;
}

const intrinsicsChoices = ["auto", "consider", "off"] as const;

/** Blocks chosen one by one, as a select holds them. */
export const chosenBlocks = "blocks";

/** Noise densities that a run was given, as a select holds them: no preset is called so. */
export const givenDensities = "densities given before";

/** No limit, where an empty field stands for the published method's own. */
const unlimited = "all";

/** The choices of a run, as a draft of the next one: nothing that it was told is lost.   told: the settings of one told nothing. */
export function draftOf(settings: Served, usual: Usual, told: Served): Draft {
  const noise = settings.imu_noise ?? "";
  const paper = settings.method === "paper";
  return {
    method: settings.method,
    points: limitText(settings.points_per_plane_per_scan ?? null, paper ? usual.paper_points_per_plane_per_scan : null),
    fieldDeg: limitText(settings.field_of_view_deg ?? null, paper ? usual.paper_field_of_view_deg : null),
    timeOffset: settings.estimate_time_offset,
    planes: settings.estimate_planes,
    priors: settings.priors.map(priorText),
    ...gravityDraft(settings.gravity, usual, told.gravity),
    imuNoise: typeof noise === "string" ? noise : givenDensities,
    biasModel: settings.bias_model,
    imuSampling: settings.imu_sampling,
    lidarSampling: settings.lidar_sampling,
    intrinsics: Array.isArray(settings.intrinsics) ? chosenBlocks : settings.intrinsics,
    lidar: settings.lidar ?? "",
    seed: settings.random_seed === 0 ? "" : String(settings.random_seed),
    rounds: settings.max_rounds === usual.max_rounds ? "" : String(settings.max_rounds),
  };
}

/** The draft with a row for the axis that somebody was sent here to give: empty where nothing was given for it before. */
export function asking(draft: Draft, sought: string | null): Draft {
  const axis = axes.find((one) => one === sought);
  if (axis === undefined || draft.priors.some((prior) => prior.axis === axis)) return draft;
  return { ...draft, priors: [...draft.priors, { axis, value: "", sigma: "" }] };
}

/** A limit as it is typed; `empty` is what nothing stands for. */
function limitText(limit: number | null, empty: number | null): string {
  return limit === empty ? "" : limit === null ? unlimited : String(limit);
}

function gravityDraft(
  { magnitude_m_s2, std_m_s2 }: Served["gravity"],
  usual: Usual,
  told: Served["gravity"],
): Pick<Draft, "gravity" | "gravityNumber"> {
  if (magnitude_m_s2 === told.magnitude_m_s2 && std_m_s2 === told.std_m_s2)
    return { gravity: "free", gravityNumber: "" };
  if (std_m_s2 === 0 && isOnEarth(magnitude_m_s2)) return { gravity: "exact", gravityNumber: String(magnitude_m_s2) };
  const latitudeDeg = std_m_s2 === usual.latitude_gravity_std_m_s2 ? latitudeOf(magnitude_m_s2) : null;
  return latitudeDeg === null
    ? { gravity: "before", gravityNumber: "" }
    : { gravity: "latitude", gravityNumber: String(latitudeDeg) };
}

/** A field whose number is missing or out of its range: its name in the form, what people call it, and what it takes. */
export interface Problem {
  field: string;
  text: string;
}

/** The field of a prior, by its place in the list. */
export const priorField = (place: number, part: "value" | "sigma") => `prior ${place} ${part}`;

/** The numbers of a draft, from the top of the form to its end: null is no limit, undefined what is missing or out of its range. */
function numbersOf(draft: Draft, usual: Usual) {
  const paper = draft.method === "paper";
  const whole = (least: number) => (value: number) => Number.isInteger(value) && value >= least;
  const upToHalfTurn = (value: number) => value > 0 && value <= 180;
  return {
    points: limitOf(draft.points, whole(1), paper ? usual.paper_points_per_plane_per_scan : null),
    fieldDeg: limitOf(draft.fieldDeg, upToHalfTurn, paper ? usual.paper_field_of_view_deg : null),
    rounds: optional(draft.rounds, whole(1), usual.max_rounds),
    seed: optional(draft.seed, whole(0), 0),
  };
}

/** What stands in the way of a solve with this draft, from the top of the form to its end. */
export function problemsOf(draft: Draft, usual: Usual, axisNames: Partial<Record<string, string>>): Problem[] {
  const check = (field: string, bad: boolean, text: string): Problem[] => (bad ? [{ field, text }] : []);
  const { points, fieldDeg, rounds, seed } = numbersOf(draft, usual);
  return [
    ...draft.priors.flatMap(({ axis, value, sigma }, place) => {
      const name = axisNames[axis] ?? axis;
      const std = numberOf(sigma);
      return [
        ...check(
          priorField(place, "value"),
          numberOf(value) === null,
          `${name}: its value in ${unitOf(axis)} is missing.`,
        ),
        ...check(
          priorField(place, "sigma"),
          std === null || std <= 0,
          `${name}: its standard deviation, a number above 0 ${unitOf(axis)}, is missing.`,
        ),
      ];
    }),
    ...check(
      "gravity",
      gravityOf(draft, usual, null) === undefined,
      draft.gravity === "latitude" ? "Latitude: a number from −90 to 90°." : "Gravity: a number between 9 and 10 m/s².",
    ),
    ...check("points", points === undefined, "Points per plane and scan: a whole number above 0, “all”, or nothing."),
    ...check("field", fieldDeg === undefined, "Field of view: a number up to 180°, “all”, or nothing."),
    ...check("rounds", rounds === undefined, "Most rounds: a whole number above 0."),
    ...check("seed", seed === undefined, "Seed of the plane search: a whole number."),
  ];
}

/** The settings that a draft stands for, the rest as before; null while a number is unfinished or out of its range. */
export function settingsOf(draft: Draft, before: Served, usual: Usual): Partial<Settings> | null {
  const { points, fieldDeg, rounds, seed } = numbersOf(draft, usual);
  const gravity = gravityOf(draft, usual, before.gravity);
  const priors = draft.priors.map((text) => untouched(text, before) ?? priorOf(text));
  if (points === undefined || fieldDeg === undefined || gravity === undefined) return null;
  if (seed === undefined || rounds === undefined || priors.some((prior) => prior === null)) return null;
  return {
    method: draft.method,
    points_per_plane_per_scan: points,
    field_of_view_deg: fieldDeg,
    estimate_time_offset: draft.timeOffset,
    estimate_planes: draft.planes,
    priors: priors.filter((prior) => prior !== null),
    bias_model: draft.biasModel === "constant" ? "constant" : "random-walk",
    imu_sampling: draft.imuSampling === "even" ? "even" : draft.imuSampling === "as-stamped" ? "as-stamped" : "detect",
    lidar_sampling: draft.lidarSampling === "as-stamped" ? "as-stamped" : "detect",
    cloud: before.cloud,
    crispness: before.crispness,
    // Densities, and blocks that were named one by one, stay as they were.
    imu_noise: draft.imuNoise === givenDensities ? before.imu_noise : draft.imuNoise === "" ? null : draft.imuNoise,
    excluded_spans_s: before.excluded_spans_s.map((span): [number, number] => [span[0] ?? 0, span[1] ?? 0]),
    intrinsics: intrinsicsChoices.find((choice) => choice === draft.intrinsics) ?? before.intrinsics,
    lidar: draft.lidar === "" ? null : draft.lidar,
    random_seed: seed,
    max_rounds: rounds,
    ...(gravity === null ? {} : { gravity }),
  };
}

/** The prior of the run before that a text still stands for: it has more digits than people read. */
function untouched(text: PriorText, before: Served): Prior | undefined {
  return before.priors.find((prior) => {
    const { axis, value, sigma } = priorText(prior);
    return axis === text.axis && value === text.value && sigma === text.sigma;
  });
}

/** The number, what stands for an empty field, or undefined for what is no number that fits. */
function optional<Empty extends number | null>(
  text: string,
  fits: (value: number) => boolean,
  empty: Empty,
): number | Empty | undefined {
  if (text.trim() === "") return empty;
  const value = numberOf(text);
  return value !== null && fits(value) ? value : undefined;
}

/** The number of a limit, null for none; what stands for an empty field, or undefined for what is no number that fits. */
function limitOf(text: string, fits: (value: number) => boolean, empty: number | null): number | null | undefined {
  return text.trim().toLowerCase() === unlimited ? null : optional(text, fits, empty);
}

function isOnEarth(magnitude_m_s2: number): boolean {
  return magnitude_m_s2 > 9 && magnitude_m_s2 < 10;
}

/** The gravity that is meant; null for the server's own, undefined while a number is missing.   before: of the run before. */
function gravityOf(
  { gravity, gravityNumber }: Draft,
  usual: Usual,
  before: Served["gravity"] | null,
): Settings["gravity"] | null | undefined {
  if (gravity === "free") return null;
  if (gravity === "before") return before;
  const value = numberOf(gravityNumber);
  if (value === null) return undefined;
  if (gravity === "exact") return isOnEarth(value) ? { magnitude_m_s2: value, std_m_s2: 0 } : undefined;
  if (Math.abs(value) > 90) return undefined;
  const std_m_s2 = usual.latitude_gravity_std_m_s2;
  // A latitude has fewer digits than the gravity it was read from.
  return before?.std_m_s2 === std_m_s2 && latitudeOf(before.magnitude_m_s2) === value
    ? before
    : { magnitude_m_s2: gravityAt(value), std_m_s2 };
}
