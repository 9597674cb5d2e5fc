import {
  createContext,
  useCallback,
  useContext,
  useEffect,
  useId,
  useLayoutEffect,
  useMemo,
  useRef,
  useState,
  type ReactNode,
} from "react";
import { pressedKeys, typesText } from "./keys";

export interface Shortcut {
  /** As in `mod+z`, `Space`, `ArrowLeft`, `?`; `mod` is Ctrl, or Command on a Mac. */
  keys: string;
  label: string;
  run: () => void;
}

export interface ShortcutGroup {
  title: string;
  shortcuts: readonly Shortcut[];
}

interface Registry {
  put: (id: string, group: ShortcutGroup | null) => void;
  groups: () => ShortcutGroup[];
  handle: (event: KeyboardEvent) => void;
  enabled: boolean;
  setEnabled: (on: boolean) => void;
}

const storageKey = "unsweep-single-keys";
const RegistryContext = createContext<Registry | null>(null);

/** Collects the shortcuts of whatever is on screen, and runs them. */
export function ShortcutProvider({ children }: { children: ReactNode }) {
  const registered = useRef(new Map<string, ShortcutGroup>());
  const [enabled, setEnabledState] = useState(() => localStorage.getItem(storageKey) !== "off");

  const put = useCallback((id: string, group: ShortcutGroup | null) => {
    if (group === null) registered.current.delete(id);
    else registered.current.set(id, group);
  }, []);

  const handle = useCallback(
    (event: KeyboardEvent) => {
      if (event.defaultPrevented || document.querySelector('[aria-modal="true"]') !== null) return;
      const pressed = pressedKeys(event);
      const single = !pressed.startsWith("mod+");
      if (single && (!enabled || typesText(event))) return;
      for (const group of registered.current.values()) {
        const found = group.shortcuts.find((shortcut) => shortcut.keys === pressed);
        if (found !== undefined) {
          event.preventDefault();
          found.run();
          return;
        }
      }
    },
    [enabled],
  );

  useEffect(() => {
    window.addEventListener("keydown", handle);
    return () => window.removeEventListener("keydown", handle);
  }, [handle]);

  const registry = useMemo<Registry>(
    () => ({
      put,
      handle,
      groups: () => [...registered.current.values()].filter((group) => group.shortcuts.length > 0),
      enabled,
      setEnabled: (on) => {
        localStorage.setItem(storageKey, on ? "on" : "off");
        setEnabledState(on);
      },
    }),
    [put, handle, enabled],
  );
  return <RegistryContext value={registry}>{children}</RegistryContext>;
}

export function useShortcutRegistry(): Registry {
  const registry = useContext(RegistryContext);
  if (registry === null) throw new Error("useShortcutRegistry needs a ShortcutProvider above it");
  return registry;
}

/** Makes these shortcuts work, and shows them in the help, while the component is on screen. */
export function useShortcuts(title: string, shortcuts: readonly Shortcut[]): void {
  const { put } = useShortcutRegistry();
  const id = useId();
  // With the commit, not after it: a key pressed right behind a change must find what that change made possible.
  useLayoutEffect(() => {
    put(id, { title, shortcuts });
    return () => put(id, null);
  });
}
