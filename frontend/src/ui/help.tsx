import { Kbd, Modal, Switch } from "@mantine/core";
import { keycaps } from "./keys";
import css from "./shell.module.css";
import { useShortcutRegistry } from "./shortcuts";

/** Every key that works on this screen. */
export function HelpDialog({ opened, onClose }: { opened: boolean; onClose: () => void }) {
  const registry = useShortcutRegistry();
  return (
    <Modal opened={opened} onClose={onClose} title="Keyboard" size={620} closeButtonProps={{ "aria-label": "Close" }}>
      <div className={css.help}>
        {registry.groups().map((group) => (
          <section key={group.title} aria-label={group.title}>
            <h2>{group.title}</h2>
            <dl>
              {group.shortcuts.map((shortcut) => (
                <div key={shortcut.keys} className={css.helpRow}>
                  <dt>{shortcut.label}</dt>
                  <dd>
                    {keycaps(shortcut.keys).map((cap) => (
                      <Kbd key={cap} size="sm">
                        {cap}
                      </Kbd>
                    ))}
                  </dd>
                </div>
              ))}
            </dl>
          </section>
        ))}
      </div>
      <Switch
        mt="md"
        label="Single keys act at once (switch off if you dictate or use a screen reader)"
        checked={registry.enabled}
        onChange={(event) => registry.setEnabled(event.currentTarget.checked)}
      />
    </Modal>
  );
}
