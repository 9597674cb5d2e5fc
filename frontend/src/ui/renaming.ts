import { useRef, useState } from "react";

interface Renaming {
  renaming: boolean;
  setRenaming: (renaming: boolean) => void;
  /** What an item of a menu does that asks for a new name. */
  ask: () => void;
  /** The menu's own `onExitTransitionEnd`: until it has gone it holds the focus, and a field opened sooner would lose it at once. */
  menuGone: () => void;
}

/** A name that becomes a field, at once or from a menu. */
export function useRenaming(): Renaming {
  const [renaming, setRenaming] = useState(false);
  const asked = useRef(false);
  const ask = () => {
    asked.current = true;
  };
  const menuGone = () => {
    if (asked.current) setRenaming(true);
    asked.current = false;
  };
  return { renaming, setRenaming, ask, menuGone };
}
