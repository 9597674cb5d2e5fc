"""A state of the joint estimation written down, and read again: a step that fails on a recording can be run by itself.

Two files: `NAME.npz` has the arrays, `NAME.json` everything else, by the names of the fields. What does not change on
the way (`JointData`) comes from the recording again, by the stages before, which give the same each time.

    state = load_estimation(folder / "before-propagation")
    propagate(data, state, FULL)
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from calib_core.full.joint.estimation import Estimation
from calib_core.record_files import Json, as_read, as_written


def save_estimation(state: Estimation, path: Path) -> None:
    """Write a state to `path`, with the endings .json and .npz."""
    words, arrays = as_written(state)
    path.with_suffix(".json").write_text(json.dumps(words, indent=1) + "\n", encoding="utf-8")
    np.savez_compressed(path.with_suffix(".npz"), allow_pickle=False, **arrays)


def load_estimation(path: Path) -> Estimation:
    """The state that was written to `path`."""
    words: Json = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    with np.load(path.with_suffix(".npz"), allow_pickle=False) as stored:
        return as_read(Estimation, words, {name: stored[name] for name in stored.files})
