"""Pages that a computing process keeps, counted by the system."""

from __future__ import annotations

import subprocess
import sys

import pytest

_COUNTED = """
import resource, sys
import numpy as np
if sys.argv[1] == "kept":
    from app.memory import keep_freed_memory
    keep_freed_memory()
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
def round_():
    some = [np.ones(2**21) for _ in range(4)]
round_()
before = faults()
for _ in range(5):
    round_()
print(faults() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks Linux's counters of the GNU library's memory")
def test_arrays_of_a_next_step_have_the_pages_of_the_last() -> None:
    """Five times four arrays of 16 MB: 80 000 pages of 4 kB, or 160 of 2 MB, where they are fetched anew; hardly any where kept.

    Mutation: arrays with pages of their own.
    """
    told = [
        int(subprocess.run([sys.executable, "-c", _COUNTED, how], capture_output=True, text=True, check=True).stdout)
        for how in ("given back", "kept")
    ]
    assert told[1] < 0.1 * told[0]
