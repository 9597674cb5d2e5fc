import { ActionIcon, CopyButton, TextInput, Tooltip } from "@mantine/core";
import { useState, type MouseEvent } from "react";
import { Link } from "react-router";
import { useDeleteRecording } from "../../api/changes";
import { useNow } from "../../ui/clock";
import { ago, bytes } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { isSecondOfDouble } from "../../ui/keys";
import { Fault } from "../../ui/notice";
import { useRefreshStorage, useShare, type RecordingUse } from "./queries";
import css from "./storage.module.css";

/** One recording: what it takes, a link to show it to others, and its removal, which is asked twice. */
export function RecordingUseRow({ use }: { use: RecordingUse }) {
  const now = useNow(30_000);
  const remove = useDeleteRecording();
  const refresh = useRefreshStorage();
  const share = useShare(use.recording_id);
  const [sure, setSure] = useState(false);
  const drop = (event: MouseEvent) => {
    if (isSecondOfDouble(event)) return;
    if (sure) remove.mutate(use.recording_id, { onSuccess: refresh });
    setSure(!sure);
  };
  const label = sure ? `Yes, remove ${use.name} and its results` : `Remove ${use.name}`;
  const fault = share.error ?? remove.error;
  return (
    <>
      <tr>
        <th scope="row">
          <Link to={`/r/${use.recording_id}/recording`}>{use.name}</Link>
        </th>
        <td className="num" data-name="File">
          {use.origin === "folder" ? "in place" : bytes(use.source_bytes)}
        </td>
        <td className="num" data-name="Read from it">
          {bytes(use.arrays_bytes)}
        </td>
        <td className="num" data-name="Results">
          {bytes(use.results_bytes)}
        </td>
        <td data-name="Last used">{ago(Date.parse(use.last_used_at), now)}</td>
        <td className={css.actions}>
          <div>
            <Tooltip label="A link for others, for a day: they can look and change nothing">
              <ActionIcon
                variant="subtle"
                color="gray"
                aria-label={`Make a link to ${use.name}`}
                loading={share.isPending}
                onClick={() => share.mutate()}
              >
                <Icon name="copy" />
              </ActionIcon>
            </Tooltip>
            <Tooltip label={label}>
              <ActionIcon
                variant={sure ? "filled" : "subtle"}
                color={sure ? "red" : "gray"}
                aria-label={label}
                loading={remove.isPending}
                onClick={drop}
                onBlur={() => setSure(false)}
              >
                <Icon name="trash" />
              </ActionIcon>
            </Tooltip>
          </div>
        </td>
      </tr>
      {(share.data !== undefined || fault !== null) && (
        <tr>
          <td colSpan={6}>
            {fault !== null ? <Fault error={fault} /> : share.data && <ShareLink path={share.data.path} />}
          </td>
        </tr>
      )}
    </>
  );
}

function ShareLink({ path }: { path: string }) {
  const address = `${window.location.origin}${path}`;
  return (
    <div className={css.link}>
      <TextInput
        size="xs"
        readOnly
        value={address}
        aria-label="Link to look at the recording"
        onFocus={(event) => event.currentTarget.select()}
      />
      <CopyButton value={address}>
        {({ copied, copy }) => (
          <ActionIcon variant="default" aria-label={copied ? "Copied" : "Copy the link"} onClick={copy}>
            <Icon name={copied ? "check" : "copy"} size={14} />
          </ActionIcon>
        )}
      </CopyButton>
    </div>
  );
}
