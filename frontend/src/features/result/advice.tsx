import type { CalibrationResult } from "../../api/client";
import { Notice } from "../../ui/notice";
import css from "./result.module.css";

/** Everything the run wants a person to know, gravest first; plain information is folded away. */
export function Messages({ messages }: { messages: CalibrationResult["messages"] }) {
  const notable = messages.filter((message) => message.level !== "info");
  const plain = messages.filter((message) => message.level === "info");
  if (messages.length === 0) return null;
  return (
    <section aria-label="Messages" className={css.stack}>
      {notable.map((message, i) => (
        <Notice key={i} level={message.level}>
          {message.text}
        </Notice>
      ))}
      {plain.length > 0 && (
        <details className={css.details}>
          <summary>
            {plain.length} {plain.length === 1 ? "note" : "notes"} on how it was done
          </summary>
          <ul>
            {plain.map((message, i) => (
              <li key={i}>{message.text}</li>
            ))}
          </ul>
        </details>
      )}
    </section>
  );
}

/** Which directions the recording leaves open, and which motion closes them. */
export function Advice({ observability }: { observability: CalibrationResult["observability"] }) {
  const { weak_directions: weak = [], advice = [] } = observability;
  if (weak.length === 0 && advice.length === 0) return null;
  return (
    <section className={css.columns} aria-label="What is weak, and what to record next">
      {weak.length > 0 && (
        <div>
          <h2>Weakest directions</h2>
          <ul className={css.bullets}>
            {weak.map((direction, i) => (
              <li key={i}>{direction.text}</li>
            ))}
          </ul>
        </div>
      )}
      {advice.length > 0 && (
        <div>
          <h2>What to record next</h2>
          <ul className={css.bullets}>
            {advice.map((sentence) => (
              <li key={sentence}>{sentence}</li>
            ))}
          </ul>
        </div>
      )}
    </section>
  );
}
