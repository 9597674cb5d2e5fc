import { Button, NativeSelect, Skeleton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { exportQuery, exportUrl, factsQuery } from "../../api/queries";
import { Icon } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import { Section } from "../../ui/panel";
import { CopyBox } from "./copybox";
import css from "./result.module.css";

/** The same extrinsic as other programs want it. */
export function Exports({ jobId, answered }: { jobId: string; answered: boolean }) {
  const formats = useQuery(factsQuery).data?.export_formats ?? [];
  const [chosen, setChosen] = useState<string | null>(null);
  const format = chosen ?? formats[0] ?? "matrix";
  const text = useQuery({ ...exportQuery(jobId, format), enabled: answered && formats.length > 0 });
  if (!answered) {
    return (
      <Section title="For your own software">
        <p className="dim small">A refused run has no transform to export; the JSON has its reasons.</p>
      </Section>
    );
  }
  return (
    <Section title="For your own software">
      <div className={css.exportHead}>
        <NativeSelect
          size="xs"
          aria-label="Format"
          data={formats}
          value={format}
          onChange={(event) => setChosen(event.currentTarget.value)}
        />
        <Button
          component="a"
          href={exportUrl(jobId, format)}
          download={`extrinsic.${format}.txt`}
          variant="default"
          size="xs"
          leftSection={<Icon name="download" size={14} />}
        >
          Save
        </Button>
      </div>
      <div className={css.exportBody}>
        {text.isError ? (
          <Fault error={text.error} />
        ) : text.isPending ? (
          <Skeleton height={120} />
        ) : (
          <CopyBox text={text.data.trimEnd()} label={`the ${format} text`} />
        )}
      </div>
    </Section>
  );
}
