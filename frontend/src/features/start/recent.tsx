import { ActionIcon, Menu, NativeSelect, Skeleton, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link } from "react-router";
import type { Recording } from "../../api/client";
import { useChangeRecording, useDeleteRecording } from "../../api/changes";
import { recordingsQuery } from "../../api/queries";
import { useNow } from "../../ui/clock";
import { ago, bytes } from "../../ui/format";
import { Icon, LevelIcon } from "../../ui/icons";
import { Fault, StateBox } from "../../ui/notice";
import { isSecondOfDouble } from "../../ui/keys";
import { Panel } from "../../ui/panel";
import { RenameField } from "../../ui/renamefield";
import { useRenaming } from "../../ui/renaming";
import { listed, standingOf, type Order } from "./standing";
import css from "./start.module.css";

/** Everything the server holds, newest first, each with where it stands. */
export function RecentRecordings({ onOpen }: { onOpen: (id: string) => void }) {
  const recordings = useQuery({ ...recordingsQuery, refetchInterval: 10_000 });
  return (
    <Panel
      title="Recordings"
      tools={
        <Link to="/storage" className="dim small">
          Storage
        </Link>
      }
    >
      {recordings.isPending ? (
        [0, 1, 2].map((i) => <Skeleton key={i} height={46} mb={10} />)
      ) : recordings.isError ? (
        <Fault error={recordings.error} onRetry={() => void recordings.refetch()} />
      ) : recordings.data.length === 0 ? (
        <StateBox title="Nothing here yet">
          <p>What you open stays here, with its planes, runs and results, until you remove it.</p>
        </StateBox>
      ) : (
        <Found recordings={recordings.data} onOpen={onOpen} />
      )}
    </Panel>
  );
}

/** Fewer than these are seen at a glance. */
const manyRecordings = 5;

function Found({ recordings, onOpen }: { recordings: readonly Recording[]; onOpen: (id: string) => void }) {
  const [wanted, setWanted] = useState("");
  const [order, setOrder] = useState<Order>("newest");
  const found = listed(recordings, wanted, order);
  return (
    <>
      {recordings.length >= manyRecordings && (
        <div className={css.find}>
          <TextInput
            size="xs"
            type="search"
            aria-label="Search recordings"
            placeholder="Search"
            value={wanted}
            onChange={(event) => setWanted(event.currentTarget.value)}
          />
          <NativeSelect
            size="xs"
            aria-label="Order of the recordings"
            value={order}
            data={[
              { value: "newest", label: "newest first" },
              { value: "name", label: "by name" },
              { value: "largest", label: "largest first" },
              { value: "standing", label: "by verdict" },
            ]}
            onChange={(event) => setOrder(event.currentTarget.value as Order)}
          />
        </div>
      )}
      {found.length === 0 && (
        <p className="dim small">No recording has “{wanted}” in its name, its state or its note.</p>
      )}
      <ul>
        {found.map((recording) => (
          <Row key={recording.id} recording={recording} onOpen={onOpen} />
        ))}
      </ul>
    </>
  );
}

function Row({ recording, onOpen }: { recording: Recording; onOpen: (id: string) => void }) {
  const remove = useDeleteRecording();
  const now = useNow(30_000);
  const change = useChangeRecording(recording.id);
  const [menu, setMenu] = useState(false);
  const [sure, setSure] = useState(false);
  const { renaming, setRenaming, ask, menuGone } = useRenaming();
  const standing = standingOf(recording);
  return (
    <li className={css.row}>
      {renaming && (
        <RenameField
          name={recording.name}
          label="New name of the recording"
          maxLength={200}
          onRename={(name) => change.mutateAsync({ name })}
          onDone={() => setRenaming(false)}
        />
      )}
      <Link
        className={css.open}
        hidden={renaming}
        to={`/r/${recording.id}/${standing.screen}${standing.job === undefined ? "" : `?job=${standing.job}`}`}
      >
        <strong className="clip" title={recording.name}>
          {recording.name}
        </strong>
        <span className={css.meta}>
          <LevelIcon level={standing.tone} size={14} />
          <span>{standing.text}</span>
          <span>·</span>
          <span className="num nowrap">{bytes(recording.size_bytes)}</span>
          <span>·</span>
          <span className="nowrap">{ago(Date.parse(recording.created_at), now)}</span>
        </span>
        {recording.note !== "" && (
          <span className={css.note} title={recording.note}>
            {recording.note}
          </span>
        )}
      </Link>
      <Menu
        position="bottom-end"
        returnFocus={false}
        opened={menu}
        onChange={setMenu}
        onClose={() => setSure(false)}
        onExitTransitionEnd={menuGone}
      >
        <Menu.Target>
          <ActionIcon
            variant="subtle"
            color="gray"
            aria-label={`More for ${recording.name}`}
            loading={remove.isPending}
          >
            <Icon name="more" />
          </ActionIcon>
        </Menu.Target>
        <Menu.Dropdown>
          <Menu.Item leftSection={<Icon name="file" />} onClick={() => onOpen(recording.id)}>
            Look at the recording
          </Menu.Item>
          <Menu.Item leftSection={<Icon name="pencil" />} onClick={ask}>
            Rename
          </Menu.Item>
          <Menu.Item
            leftSection={<Icon name="trash" />}
            className={sure ? (css.sure ?? "") : ""}
            closeMenuOnClick={false}
            onClick={(event) => {
              if (isSecondOfDouble(event)) return;
              if (sure) remove.mutate(recording.id);
              setMenu(!sure);
              setSure(!sure);
            }}
          >
            {sure ? "Yes, remove it and its results" : "Remove…"}
          </Menu.Item>
        </Menu.Dropdown>
      </Menu>
    </li>
  );
}
