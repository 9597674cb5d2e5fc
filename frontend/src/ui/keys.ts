/** The pressed combination in the notation of shortcuts: `mod+shift+z`, `Space`, `ArrowLeft`, `?`. */
export function pressedKeys(event: KeyboardEvent): string {
  const mod = event.ctrlKey || event.metaKey ? "mod+" : "";
  const alt = event.altKey ? "alt+" : "";
  const key = event.key === " " ? "Space" : event.key.length === 1 ? event.key.toLowerCase() : event.key;
  // Shift is part of what a printable sign is ("?"), except for letters and named keys.
  const shift = event.shiftKey && (key.length > 1 || /[a-z]/.test(key)) ? "shift+" : "";
  return `${mod}${alt}${shift}${key}`;
}

const editable = 'input:not([type="checkbox"]):not([type="radio"]), textarea, select, [contenteditable="true"]';
const usesArrows = '[role="slider"], [role="radiogroup"], [role="menu"], [role="listbox"], input[type="radio"]';

/** Whether the focused element wants this key for itself. */
export function typesText(event: KeyboardEvent): boolean {
  const target = event.target;
  if (!(target instanceof Element)) return false;
  if (target.closest(editable) !== null) return true;
  if (event.key === " " || event.key === "Enter")
    return target.closest("button, a, summary, input, [role='switch']") !== null;
  return /^(Arrow|Page|Home|End)/.test(event.key) && target.closest(usesArrows) !== null;
}

/** Whether a click is the second of a double one, which confirms nothing: a question that comes up under the pointer has not been
 *  read yet. Keys click with a count of none. */
export function isSecondOfDouble({ detail }: Pick<MouseEvent, "detail">): boolean {
  return detail > 1;
}

const names: Record<string, string> = {
  mod: /Mac/.test(navigator.userAgent) ? "⌘" : "Ctrl",
  shift: "Shift",
  alt: "Alt",
  ArrowLeft: "←",
  ArrowRight: "→",
  ArrowUp: "↑",
  ArrowDown: "↓",
};

/** The keycaps of a combination, in order. */
export function keycaps(keys: string): string[] {
  // What joins keys is a key, too.
  return (keys === "+" ? [keys] : keys.split("+")).map(
    (key) => names[key] ?? (key.length === 1 ? key.toUpperCase() : key),
  );
}
