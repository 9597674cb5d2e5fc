import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useNavigate } from "react-router";
import { sparse, type CalibrationResult, type Patch, type Recording, type Run } from "../../api/client";
import { useStartJob } from "../../api/changes";
import { planesQuery, useEditPlanes } from "../../api/planes";
import { Fault } from "../../ui/notice";
import { spansOf } from "../inspect/spans";

/** The patches of today that a run calls doubtful and that counted in it all the same: by their colour and what they are called. */
export function culpritsOf(
  patches: readonly Patch[],
  run: Pick<Run["job"], "planes">,
  messages: CalibrationResult["messages"],
): Patch[] {
  const doubted = messages.filter(({ code }) => code === "planes.doubted").map(({ text }) => text);
  const looks = (run.planes ?? []).filter(({ name }) => doubted.some((text) => text.startsWith(`${name} `)));
  return patches.filter(
    (patch) => patch.confirmed && looks.some(({ title, color }) => title === patch.name && color === patch.color),
  );
}

interface LeaveOutProps {
  recording: Recording;
  run: Run;
  result: CalibrationResult;
}

/** The cure that a doubtful plane's verdict names, as a button: dropped among the planes, and the same solve again. */
export function LeaveOut({ recording, run, result }: LeaveOutProps) {
  const navigate = useNavigate();
  const planes = useQuery(planesQuery(recording.id)).data;
  const edit = useEditPlanes(recording.id);
  const start = useStartJob(recording.id);
  const culprits = planes === undefined ? [] : culpritsOf(planes.patches, run.job, result.messages);
  const [first, ...more] = culprits;
  if (first === undefined) return null;
  const again = async () => {
    for (const { index } of culprits) await edit.mutateAsync({ op: "drop", index });
    const settings = sparse({ ...run.job.settings, excluded_spans_s: spansOf(run) });
    const made = await start.mutateAsync({ kind: "solve", settings });
    await navigate(`/r/${recording.id}/solve?job=${made.id}`);
  };
  return (
    <>
      <Button
        size="compact-md"
        loading={edit.isPending || start.isPending}
        onClick={() => void again().catch(() => undefined)}
      >
        Leave {more.length > 0 ? `these ${String(culprits.length)} planes` : first.name} out and solve again
      </Button>
      {edit.isError && <Fault error={edit.error} />}
      {start.isError && <Fault error={start.error} />}
    </>
  );
}
