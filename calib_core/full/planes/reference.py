"""The planes of the clearest scan: the user's, else those found around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calib_core.errors import Refused
from calib_core.full.planes.propose import find_reference, propose_planes
from calib_core.full.run import Run
from calib_core.types import Plane, PlaneProposals

NO_PLANES_TEXT = "no plane was found in any scan; record in front of walls and floor, at 1 to 20 m"


@dataclass(frozen=True, slots=True)
class Reference:
    """scan: position of the one in whose frame the planes are.   given: they are the user's, and stay as they are."""

    scan: int
    planes: tuple[Plane, ...]
    given: bool


def reference_planes(run: Run, given: Sequence[Plane] | None) -> Reference:
    """The reference scan and its planes. Raises Refused where no scan shows any."""
    if given is not None:
        scan, _ = find_reference(run.recording.scans, run.settings, should_cancel=run.should_cancel)
        reference = Reference(scan, tuple(given), given=True)
    else:
        proposals = propose_planes(run.recording, run.settings, on_event=run.on_event, should_cancel=run.should_cancel)
        reference = proposed(proposals)
    if not reference.planes:
        raise Refused("planes.none", NO_PLANES_TEXT)
    return reference


def proposed(proposals: PlaneProposals) -> Reference:
    """Proposed planes, all of them."""
    return Reference(proposals.reference_scans[0], tuple(patch.plane for patch in proposals.patches), given=False)
