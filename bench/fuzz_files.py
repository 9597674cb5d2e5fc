"""Spoilt bytes by the ten thousand: `python -m bench.fuzz_files [--count 20000 --seed 1 --only KIND ...]`.

Beside what `bench.fuzz_http` asks: archives whose headers lie, compressed chunks that are cut and flipped and declared to
be of any size, message definitions that name themselves, nest without end or have arrays of 2^31, and what a browser may
say to the scene. `tests.core.readers.damage` does the same with whole recordings, point by point.

Each is taken or refused in one sentence. Anything else is a defect: another exception, a byte beside the folder that was
given or beyond the limit, a message that reads otherwise than under its honest definition. Seeded: input n of a kind is
the same wherever it is run.
"""

from __future__ import annotations

import argparse
import random
import resource
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from bench.fuzz_archives import archives, chunks
from bench.fuzz_definitions import definitions
from bench.fuzz_scene import said


@dataclass
class Found:
    """What became of the inputs, by kind, and what should not have."""

    outcomes: dict[str, Counter[str]] = field(default_factory=dict)
    defects: list[str] = field(default_factory=list)

    @property
    def inputs(self) -> int:
        """How many there were."""
        return sum(sum(each.values()) for each in self.outcomes.values())


#: The kinds, and how large a share of the inputs each is: what opens files takes longest.
KINDS: dict[str, tuple[Callable[[Path, random.Random], str], float]] = {
    "archives": (archives, 0.3),
    "chunks": (chunks, 0.23),
    "definitions": (definitions, 0.02),
    "said to the scene": (said, 0.45),
}


def run(count: int, seed: int, folder: Path, *, only: tuple[str, ...] = tuple(KINDS)) -> Found:
    """So many inputs of the kinds together."""
    found = Found()
    shares = sum(KINDS[name][1] for name in only)
    for name in only:
        given, share = KINDS[name]
        outcomes = found.outcomes[name] = Counter()
        for number in range(round(count * share / shares)):
            own = folder / "one"
            own.mkdir()
            try:
                outcomes[given(own, random.Random(f"{seed} {name} {number}"))] += 1
            except Exception as error:  # noqa: BLE001 - whatever else it is, is what is looked for
                outcomes["defect"] += 1
                found.defects.append(f"{name} {seed} {number}: {error!r:.300}")
            shutil.rmtree(own)
    return found


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", choices=list(KINDS), default=list(KINDS))
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="unsweep-fuzz-") as folder:
        found = run(chosen.count, chosen.seed, Path(folder), only=tuple(chosen.only))
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    for name, outcomes in found.outcomes.items():
        sys.stdout.write(f"{name}: {dict(outcomes)}\n")
    sys.stdout.write(f"inputs {found.inputs}, defects {len(found.defects)}, peak memory {peak_mb:.0f} MiB\n")
    for defect in found.defects[:20]:
        sys.stdout.write(defect + "\n")
    return 1 if found.defects else 0


if __name__ == "__main__":
    raise SystemExit(main())
