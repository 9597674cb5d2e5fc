import { ActionIcon, CopyButton, Tooltip } from "@mantine/core";
import { Fragment } from "react";
import { Icon } from "../../ui/icons";
import css from "./result.module.css";

interface CopyBoxProps {
  text: string;
  label: string;
  /** What it is and in which units, where the text itself does not say so. */
  caption?: string;
  wrap?: boolean;
}

/** Text to take over elsewhere, with a button that copies it. */
export function CopyBox({ text, label, caption, wrap = false }: CopyBoxProps) {
  const box = (
    <div className={css.copybox} data-wrap={wrap}>
      <pre tabIndex={0} role="group" aria-label={label}>
        {wrap
          ? text.split(" ").map((word, i) => (
              <Fragment key={i}>
                {i > 0 && " "}
                <span>{word}</span>
              </Fragment>
            ))
          : text}
      </pre>
      <CopyButton value={text}>
        {({ copied, copy }) => (
          <Tooltip label={copied ? "Copied" : `Copy ${label}`}>
            <ActionIcon size="sm" variant="default" aria-label={copied ? "Copied" : `Copy ${label}`} onClick={copy}>
              <Icon name={copied ? "check" : "copy"} size={13} />
            </ActionIcon>
          </Tooltip>
        )}
      </CopyButton>
    </div>
  );
  if (caption === undefined) return box;
  return (
    <div className={css.captioned}>
      <span className="dim small">{caption}</span>
      {box}
    </div>
  );
}
