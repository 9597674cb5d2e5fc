import { ActionIcon, Checkbox, Menu } from "@mantine/core";
import type { Operation, Patch, Planes } from "../../api/client";
import { useUsual } from "../../api/queries";
import { count, fixed } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { StateBox } from "../../ui/notice";
import { RenameField } from "../../ui/renamefield";
import { useRenaming } from "../../ui/renaming";
import { doubtOf } from "./leftout";
import css from "./planes.module.css";
import { mergeCandidates } from "./similar";

interface PatchListProps {
  planes: Planes;
  /** What is to be said of a patch, by its index. */
  remarks?: ReadonlyMap<number, string>;
  apply: (operation: Operation) => void;
  /** Rejects where the name cannot be had. */
  rename: (index: number, name: string) => Promise<unknown>;
  /** The next box drawn in the scene is to cut this patch only. */
  onRestrict: (index: number) => void;
}

/** Every patch with what a person needs to judge it. */
export function PatchList({ planes, remarks, ...asked }: PatchListProps) {
  if (planes.patches.length === 0) return <NoPlanes />;
  return (
    <table className={css.table}>
      <caption className="sr-only">Detected planes</caption>
      <thead>
        <tr>
          <th scope="col">
            <span className="sr-only">Confirmed</span>
          </th>
          <th scope="col">Plane</th>
          <th scope="col" className={css.right}>
            Area <span>m²</span>
          </th>
          <th
            scope="col"
            className={css.right}
            title={
              planes.upright
                ? "Angle between the plane and the horizontal"
                : "Angle between the plane and the horizontal, which is not known before gravity is"
            }
          >
            Tilt <span>°</span>
          </th>
          <th scope="col" className={css.right} title="Points of the cloud that lie on it">
            Points
          </th>
          <th scope="col" className={css.right} title="Root mean square distance of its points, all alike">
            Spread <span>mm</span>
          </th>
          <th scope="col">
            <span className="sr-only">Actions</span>
          </th>
        </tr>
      </thead>
      <tbody>
        {planes.patches.map((patch) => (
          <PatchRow
            key={patch.index}
            patch={patch}
            upright={planes.upright}
            all={planes.patches}
            remark={remarks?.get(patch.index) ?? doubtOf(patch)}
            {...asked}
          />
        ))}
      </tbody>
    </table>
  );
}

interface RowProps extends Omit<PatchListProps, "planes" | "remarks"> {
  patch: Patch;
  /** Whether gravity is known. */
  upright: boolean;
  remark: string | undefined;
  all: readonly Patch[];
}

function PatchRow({ patch, upright, remark, all, apply, rename, onRestrict }: RowProps) {
  const { renaming, setRenaming, ask, menuGone } = useRenaming();
  const usual = useUsual();
  const candidates = usual === undefined ? [] : mergeCandidates(patch, all, usual);
  return (
    <tr data-confirmed={patch.confirmed}>
      <td>
        <Checkbox
          size="xs"
          aria-label={`Use ${patch.name}`}
          checked={patch.confirmed}
          onChange={(event) => apply({ op: event.currentTarget.checked ? "confirm" : "drop", index: patch.index })}
        />
      </td>
      <td>
        <div className={css.nameCell}>
          <span className={css.swatch} style={{ background: patch.color }} />
          <span
            className={css.name}
            data-renaming={renaming}
            onDoubleClick={() => setRenaming(true)}
            title="Double click: rename"
          >
            {patch.name}
          </span>
          {renaming && (
            <div className={css.renaming}>
              <RenameField
                name={patch.name}
                label="New name"
                onRename={(name) => rename(patch.index, name)}
                onDone={() => setRenaming(false)}
              />
            </div>
          )}
          {patch.restricted && (
            <span
              className={css.cut}
              title="A box leaves part of it out, in the solve too"
              role="img"
              aria-label="restricted to a box"
            >
              <Icon name="box" size={12} />
            </span>
          )}
        </div>
        {remark !== undefined && <p className={css.remark}>{remark}</p>}
        {patch.insisted && <p className={css.remark}>counts even if doubtful</p>}
      </td>
      <td className={`${css.right ?? ""} num`}>{fixed(patch.area_m2, 1)}</td>
      <td className={`${css.right ?? ""} num`}>{upright ? fixed(patch.tilt_deg, 0) : "–"}</td>
      <td className={`${css.right ?? ""} num`} title={`${count(patch.n_points)} points`}>
        {thousands(patch.n_points)}
      </td>
      <td className={`${css.right ?? ""} num`}>{fixed(patch.rms_m * 1000, 1)}</td>
      <td>
        <Menu position="bottom-end" width={220} returnFocus={false} onExitTransitionEnd={menuGone}>
          <Menu.Target>
            <ActionIcon size="sm" variant="subtle" color="gray" aria-label={`More for ${patch.name}`}>
              <Icon name="more" />
            </ActionIcon>
          </Menu.Target>
          <Menu.Dropdown>
            <Menu.Item leftSection={<Icon name="pencil" />} onClick={ask}>
              Rename
            </Menu.Item>
            <Menu.Item leftSection={<Icon name="box" />} onClick={() => onRestrict(patch.index)}>
              Restrict to a box
            </Menu.Item>
            <Menu.Item
              leftSection={<Icon name="check" />}
              disabled={patch.insisted}
              onClick={() => apply({ op: "insist", index: patch.index })}
            >
              Count it even if doubtful
            </Menu.Item>
            {candidates.map((other) => (
              <Menu.Item
                key={other.index}
                leftSection={<Icon name="merge" />}
                onClick={() => apply({ op: "merge", indices: [patch.index, other.index] })}
              >
                Merge with {other.name}
              </Menu.Item>
            ))}
            {candidates.length === 0 && (
              <Menu.Item leftSection={<Icon name="merge" />} disabled>
                No plane to merge with
              </Menu.Item>
            )}
          </Menu.Dropdown>
        </Menu>
      </td>
    </tr>
  );
}

/** In one form from row to row: 59k above 9.5k. */
export function thousands(n: number): string {
  return n < 1_000 ? count(n) : `${(n / 1000).toFixed(n < 9_950 ? 1 : 0)}k`;
}

function NoPlanes() {
  return (
    <StateBox title="No planes were found">
      <p>The cloud has no flat patch of at least half a metre; grow one by hand, or record near walls.</p>
    </StateBox>
  );
}
