import { Button, Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import type { Command } from "../../api/client";
import { commandQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import { CopyBox } from "./copybox";
import css from "./result.module.css";

/** The command that gives the same answer without a browser, and the files it reads. */
export function CommandSection({ jobId }: { jobId: string }) {
  const command = useQuery(commandQuery(jobId));
  return (
    <Section title="The same without a browser">
      {command.isPending ? (
        <Skeleton height={96} />
      ) : command.isError ? (
        <Fault error={command.error} onRetry={() => void command.refetch()} />
      ) : (
        <>
          <CopyBox text={command.data.text} label="the command" wrap />
          {command.data.files.length > 0 && (
            <div className={css.files}>
              {command.data.files.map((file) => (
                <FileLink key={file.name} file={file} />
              ))}
              <span className={css.hint}>
                {command.data.files.length === 1
                  ? "Save it where the command is run."
                  : "Save them where the command is run."}
              </span>
            </div>
          )}
          {command.data.notes.map((note) => (
            <p key={note} className={css.hint}>
              {note}
            </p>
          ))}
        </>
      )}
    </Section>
  );
}

function FileLink({ file }: { file: Command["files"][number] }) {
  return (
    <Button
      component="a"
      href={`data:application/json;charset=utf-8,${encodeURIComponent(file.text)}`}
      download={file.name}
      variant="default"
      size="compact-sm"
      leftSection={<Icon name="download" size={13} />}
    >
      {file.name}
    </Button>
  );
}
