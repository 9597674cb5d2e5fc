import type { CalibrationResult } from "../../api/client";
import { LevelIcon, type Tone } from "../../ui/icons";
import { sentenceCase } from "../../ui/words";
import css from "./result.module.css";

const words: Record<CalibrationResult["status"], string> = {
  calibrated: "Calibrated",
  weak: "Weak",
  refused: "Refused",
};
/** What speaks against an answer that is calibrated: parts that disagree, planes that are doubtful and count,
 * count for nothing, or gave way to others. */
const against = ["solve.disagreement", "planes.doubted", "planes.unseen", "planes.instead"];

/** The colour of a result: green is for an answer that nothing speaks against. */
export function toneOf(status: CalibrationResult["status"], codes: readonly string[]): Tone {
  switch (status) {
    case "refused":
      return "error";
    case "weak":
      return "warning";
    case "calibrated":
      return against.some((code) => codes.includes(code)) ? "warning" : "good";
  }
}

/** May I use this? One word, a sentence or two. */
export function Verdict({ result, text }: { result: CalibrationResult; text: string }) {
  const { status } = result;
  const tone = toneOf(
    status,
    result.messages.map((message) => message.code),
  );
  const word = words[status];
  const sentence = text.startsWith(word) ? text.slice(word.length).replace(/^[:,.] /, "") : text;
  return (
    <header className={css.verdict} data-status={status} data-tone={tone}>
      <LevelIcon level={tone} size={30} />
      <div>
        <h1>{word}</h1>
        <p>{sentenceCase(sentence)}</p>
      </div>
    </header>
  );
}
