import { TextInput } from "@mantine/core";
import { useRef, useState } from "react";
import { asFault } from "../api/fault";
import css from "./renamefield.module.css";

interface RenameFieldProps {
  name: string;
  label: string;
  maxLength?: number;
  /** Rejects where the name cannot be had. */
  onRename: (name: string) => Promise<unknown>;
  /** The name is as it is wanted, or is left as it was. */
  onDone: () => void;
}

/** A name as a field. A name that is refused stays in it, with the reason, until it is changed or given up. */
export function RenameField({ name, label, maxLength, onRename, onDone }: RenameFieldProps) {
  const [text, setText] = useState(name);
  const [refusal, setRefusal] = useState<string | null>(null);
  // What was asked for last: taking the field away counts as leaving it, which would ask once more.
  const asked = useRef(name);
  const finish = () => {
    const wanted = text.trim();
    if (wanted === "" || wanted === name) onDone();
    else if (wanted !== asked.current) {
      asked.current = wanted;
      onRename(wanted).then(onDone, (error: unknown) => setRefusal(asFault(error).message));
    }
  };
  return (
    <TextInput
      className={css.field ?? ""}
      size="xs"
      autoFocus
      aria-label={label}
      value={text}
      error={refusal}
      {...(maxLength === undefined ? {} : { maxLength })}
      onFocus={(event) => event.currentTarget.select()}
      onChange={(event) => {
        setText(event.currentTarget.value);
        setRefusal(null);
        asked.current = name;
      }}
      onBlur={finish}
      onKeyDown={(event) => {
        if (event.key === "Enter") finish();
        if (event.key === "Escape") {
          asked.current = text.trim();
          onDone();
        }
      }}
    />
  );
}
