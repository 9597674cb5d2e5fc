import { ActionIcon, CopyButton, Tooltip } from "@mantine/core";
import { Fragment } from "react";
import { Icon } from "../../ui/icons";
import css from "./result.module.css";

/** Text to take over elsewhere, with a button that copies it. */
export function CopyBox({ text, label, wrap = false }: { text: string; label: string; wrap?: boolean }) {
  return (
    <div className={css.copybox} data-wrap={wrap}>
      <pre tabIndex={0} role="group" aria-label={label}>
        {wrap ? text.split(" ").map((word, i) => <Fragment key={i}>{i > 0 && " "}<span>{word}</span></Fragment>) : text}
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
}
