import createClient from "openapi-fetch";
import { spoken } from "../ui/words";
import { faultOf } from "./fault";
import type { components, paths } from "./generated/schema";

type Schemas = components["schemas"];

/** Tuples as plain arrays: the fetch client hands every fixed-length list back as one. */
type Plain<T> = T extends readonly (infer Item)[]
  ? Plain<Item>[]
  : T extends object
    ? { [K in keyof T]: Plain<T[K]> }
    : T;

export type Recording = Plain<Schemas["Recording"]>;
export type ChangeRecording = Schemas["ChangeRecording"];
export type OpenRecording = Schemas["OpenRecording"];
export type DoctorReport = Plain<Schemas["DoctorReport"]>;
export type FindingReport = Schemas["FindingReport"];
export type ReadSettings = Schemas["ReadSettings"];
export type FolderListing = Schemas["FolderListing"];
export type FolderEntry = Schemas["FolderEntry"];
export type ServerFacts = Plain<Schemas["ServerFacts"]>;
export type Limits = Schemas["WeakLimits"];
export type Usual = Schemas["UsualNumbers"];
export type Sample = Schemas["Sample"];
export type Job = Plain<Schemas["Job"]>;
export type SolveOutcome = Extract<NonNullable<Job["result"]>, { kind?: "solve" }>;
export type NewJob = Schemas["NewJob"];
export type Planes = Schemas["Planes"];
export type Patch = Schemas["Patch"];
export type PlaneLook = Schemas["PlaneLook"];
export type View = Plain<Schemas["View"]>;
export type ChangeView = Schemas["ChangeView"];
export type Operation =
  | Schemas["Confirm"]
  | Schemas["Drop"]
  | Schemas["Toggle"]
  | Schemas["Insist"]
  | Schemas["Rename"]
  | Schemas["Merge"]
  | Schemas["Grow"]
  | Schemas["Restrict"]
  | Schemas["UseSuggestion"]
  | Schemas["Undo"]
  | Schemas["Redo"];
export type Thickness = Schemas["Thickness"];
export type WallThickness = Schemas["WallThickness"];
export type ScanQuality = Schemas["ScanQuality"];
export type OldExtrinsic = Plain<Schemas["OldExtrinsic"]>;
export type ExtrinsicText = Schemas["ExtrinsicText"];
export type NewAudit = Schemas["NewAudit"];
export type AuditReport = Schemas["AuditReport"];
export type AxisAudit = Schemas["AxisAudit"];
export type Command = Schemas["Command"];
export type Run = Plain<Schemas["Run"]>;
export type Runs = Plain<Schemas["Runs"]>;
export type CalibrationResult = Schemas["CalibrationResult"];
export type StageEvent = Schemas["StageEvent"];
export type IterationEvent = Schemas["IterationEvent"];
export type LogEvent = Schemas["LogEvent"];
export type JobStateEvent = Plain<Schemas["JobStateEvent"]>;
export type JobMessage = StageEvent | IterationEvent | LogEvent | JobStateEvent;
export type RecordingMessage = Plain<
  | Schemas["PlanesChanged"]
  | Schemas["JobChanged"]
  | Schemas["ViewChanged"]
  | Schemas["RecordingChanged"]
  | Schemas["ClickRefused"]
  | Schemas["Resync"]
>;

export const api = createClient<paths>({ baseUrl: window.location.origin });

interface Answer<T> {
  data?: T;
  error?: unknown;
  response: Response;
}

/** The body of a success; anything else is thrown as an ApiFault. */
export async function body<T>(answer: Promise<Answer<T>>): Promise<T> {
  const { data, error, response } = await answer;
  if (!response.ok || data === undefined) throw faultOf(spoken(error), response.status);
  return data;
}

/** The same with every sentence of the answer in the page's words. */
export async function told<T>(answer: Promise<Answer<T>>): Promise<T> {
  return spoken(await body(answer));
}

/** A request in which fields with a default are left out. The generated types call those fields present, which they
 *  are in answers; in requests leaving them out is how "stays as it is" is said. */
export function sparse<T>(wish: Partial<T>): T {
  return wish as T;
}
