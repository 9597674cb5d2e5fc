import { Button, Menu } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { useNavigate } from "react-router";
import { useOpenRecording } from "../../api/changes";
import { factsQuery } from "../../api/queries";
import { GuideDialog } from "../guide/dialog";
import { Icon } from "../../ui/icons";
import { Fault } from "../../ui/notice";
import { Shell } from "../../ui/shell";
import { useShortcuts } from "../../ui/shortcuts";
import { stepsOf } from "../workspace/state";
import { SweepDrawing } from "./drawing";
import { useDropZone } from "./dropzone";
import { FolderDialog } from "./folder";
import { RecentRecordings } from "./recent";
import css from "./start.module.css";

/** Where a recording comes in: dropped, opened from the server's folder, or made on the spot. */
export function StartScreen() {
  const navigate = useNavigate();
  const facts = useQuery(factsQuery);
  const open = useOpenRecording();
  const { dragging, chooseFile, chooseFolder } = useDropZone();
  const [folderOpen, setFolderOpen] = useState(false);
  const [guideOpen, setGuideOpen] = useState(false);
  const show = (id: string) => void navigate(`/r/${id}/recording`);
  const samples = facts.data?.samples ?? [];
  const firstSample = samples[0];
  const openSample = (scenario: string) => open.mutate({ sample: scenario }, { onSuccess: (made) => show(made.id) });

  useShortcuts("Start page", [
    { keys: "o", label: "Choose a file", run: chooseFile },
    { keys: "d", label: "Choose a bag's folder", run: chooseFolder },
    { keys: "g", label: "How to record", run: () => setGuideOpen(true) },
    ...(firstSample === undefined
      ? []
      : [{ keys: "s", label: "Try the sample", run: () => openSample(firstSample.scenario) }]),
    ...(facts.data?.recordings_folder === true
      ? [{ keys: "f", label: "Open from the server's folder", run: () => setFolderOpen(true) }]
      : []),
  ]);

  return (
    <Shell steps={stepsOf(undefined, undefined, [], "")} current={null}>
      <main className={css.start}>
        <div className={css.hero}>
          <div className={css.intro}>
            <h1>Where the lidar sits on the IMU, and how far their clocks are apart</h1>
            <p>
              One recording of a moving rig in a room with walls gives the transform and the time offset between the two
              sensors, with an error bar on every axis.
            </p>
          </div>
          <section className={css.drop} data-dragging={dragging} aria-label="Open a recording">
            <SweepDrawing />
            <h2>Drop a recording anywhere on this page</h2>
            <p>A ROS 1 or ROS 2 bag (.bag, .mcap, .db3), a bag&apos;s folder, or a .zip or .tar of it</p>
            <div className={css.buttons}>
              {firstSample !== undefined && samples.length === 1 && (
                <Button
                  leftSection={<Icon name="sample" />}
                  onClick={() => openSample(firstSample.scenario)}
                  loading={open.isPending}
                  title={firstSample.text}
                >
                  Try the sample
                </Button>
              )}
              {samples.length > 1 && (
                <Button.Group>
                  <Button
                    leftSection={<Icon name="sample" />}
                    onClick={() => firstSample !== undefined && openSample(firstSample.scenario)}
                    loading={open.isPending}
                    title={firstSample?.text}
                  >
                    Try the sample
                  </Button>
                  <Menu position="bottom-end" width={320}>
                    <Menu.Target>
                      <Button px={8} aria-label="Other samples" style={{ borderLeftColor: "rgb(255 255 255 / 25%)" }}>
                        <span style={{ display: "grid", transform: "rotate(90deg)" }}>
                          <Icon name="next" size={14} />
                        </span>
                      </Button>
                    </Menu.Target>
                    <Menu.Dropdown>
                      {samples.map((sample) => (
                        <Menu.Item key={sample.scenario} onClick={() => openSample(sample.scenario)}>
                          {sample.title}
                          <div className="dim small">{sample.text}</div>
                        </Menu.Item>
                      ))}
                    </Menu.Dropdown>
                  </Menu>
                </Button.Group>
              )}
              <Button variant="default" leftSection={<Icon name="file" />} onClick={chooseFile}>
                Choose a file
              </Button>
              <Button variant="default" leftSection={<Icon name="folder" />} onClick={chooseFolder}>
                Choose a folder
              </Button>
              {facts.data?.recordings_folder === true && (
                <Button variant="default" leftSection={<Icon name="server" />} onClick={() => setFolderOpen(true)}>
                  Open from the server
                </Button>
              )}
            </div>
          </section>
          <p className={css.guide}>
            <span className="dim">No recording yet, or one that was refused?</span>
            <Button variant="subtle" size="compact-sm" onClick={() => setGuideOpen(true)}>
              How to record
            </Button>
          </p>
          {[open.error, facts.error]
            .filter((error) => error !== null)
            .slice(0, 1)
            .map((error) => (
              <div className={css.fault} key="fault">
                <Fault error={error} />
              </div>
            ))}
        </div>
        <RecentRecordings onOpen={show} />
      </main>
      {guideOpen && <GuideDialog onClose={() => setGuideOpen(false)} />}
      {folderOpen && <FolderDialog onClose={() => setFolderOpen(false)} onOpened={show} />}
    </Shell>
  );
}
