import type { AuditReport } from "../../api/client";
import type { Tone } from "../../ui/icons";

type Verdict = AuditReport["verdict"];

export const verdictWords: Readonly<Record<Verdict, string>> = {
  passed: "Passed",
  failed: "Failed",
  unknown: "This recording cannot tell",
};

export const verdictTones: Readonly<Record<Verdict, Tone>> = { passed: "good", failed: "error", unknown: "warning" };
