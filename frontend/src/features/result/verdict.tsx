import type { CalibrationResult } from "../../api/client";
import { LevelIcon, type Tone } from "../../ui/icons";
import css from "./result.module.css";

const tones: Record<CalibrationResult["status"], Tone> = { calibrated: "good", weak: "warning", refused: "error" };
const words: Record<CalibrationResult["status"], string> = { calibrated: "Calibrated", weak: "Weak", refused: "Refused" };

/** May I use this? One word, one sentence. */
export function Verdict({ status, text }: { status: CalibrationResult["status"]; text: string }) {
  const word = words[status];
  const sentence = text.startsWith(`${word}: `) ? text.slice(word.length + 2) : text;
  return (
    <header className={css.verdict} data-status={status}>
      <LevelIcon level={tones[status]} size={30} />
      <div>
        <h1>{word}</h1>
        <p>{sentence.charAt(0).toUpperCase() + sentence.slice(1)}</p>
      </div>
    </header>
  );
}
