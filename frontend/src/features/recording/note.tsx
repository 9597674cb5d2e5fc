import { Textarea } from "@mantine/core";
import { useState } from "react";
import type { Recording } from "../../api/client";
import { useChangeRecording } from "../../api/changes";
import { Fault } from "../../ui/notice";

/** What a person wants to remember of a recording; kept when the field is left. */
export function Note({ recording }: { recording: Recording }) {
  const change = useChangeRecording(recording.id);
  const [text, setText] = useState(recording.note);
  const keep = () => {
    if (text.trim() !== recording.note) change.mutate({ note: text.trim() });
  };
  return (
    <>
      <Textarea
        size="xs"
        mt={8}
        aria-label="Note"
        placeholder="A note: which rig, which day, what was changed"
        minRows={1}
        maxRows={6}
        maxLength={2000}
        autosize
        value={text}
        onChange={(event) => setText(event.currentTarget.value)}
        onBlur={keep}
      />
      {change.isError && <Fault error={change.error} />}
    </>
  );
}
