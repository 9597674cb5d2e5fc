"""In which rounds the joint problem is solved.

Coarse to fine: the first rounds use the scans that could be tracked by the lidar alone and a part of their points, within
a hand's breadth of a plane; then the estimate itself is propagated over the rest of the recording; the last rounds use
every point within four standard deviations, until nothing moves. A forecast is another schedule: it ends with the motion.
The numbers of each step are its policy's (policies.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib_core.full.joint.policies import (
    Limits,
    PlaneSet,
    Propagation,
    Round,
    Sampling,
    Settling,
    Steadying,
    Surfaces,
    Tones,
)


@dataclass(frozen=True, slots=True)
class Schedule:
    """All rounds. propagation: None where the estimate stays within what was tracked.   planes: None where none joins and none
    is dropped, but for those that a person chose.   chosen: whether there are such: doubtful ones of them count, as far as the
    others hold the motion.

    instead: rounds where there is nothing to propagate to.   settling: None where the motion alone was asked for.
    """

    motion: Round
    coarse: tuple[Round, ...]
    propagation: Propagation | None
    planes: PlaneSet | None
    settling: Settling | None
    chosen: bool = False
    instead: tuple[Round, ...] = ()
    steadying: Steadying = Steadying()  # noqa: RUF009  frozen
    #: The first round in which the sensors' own parameters are unknowns: with them in place, planes are told from clutter.
    sensors: Round = Round(gate_m=0.05, iterations=8, hold=False)  # noqa: RUF009  frozen
    surfaces: Surfaces = Surfaces()  # noqa: RUF009  frozen
    tones: Tones = Tones()  # noqa: RUF009  frozen
    sampling: Sampling = Sampling()  # noqa: RUF009  frozen
    limits: Limits = Limits()  # noqa: RUF009  frozen

    def most_rounds(self, tracked_s: float, total_s: float, most_fixed_point: int) -> int:
        """Bound on the rounds in all. most_fixed_point: descents to a fixed point under the same association."""
        rounds = 2 + len(self.coarse) + 2 * self.steadying.patience + len(self.instead) + self.tones.most_rounds
        if self.propagation is not None:
            rounds += self.propagation.most_rounds(tracked_s, total_s)
        if self.planes is not None:
            rounds += 1
        if self.settling is not None:
            rounds += self.settling.rounds * (3 if self.planes is None else 3 + 2 * self.planes.turns)
            rounds += (1 + self.tones.turns) * self.settling.descents(most_fixed_point)
        return rounds


#: The calibration's. First the motion alone: which directions the data determine is judged before the calibration can
#: wander off along one that they do not.
FULL = Schedule(
    motion=Round(gate_m=0.12, iterations=4, survey=False, motion_alone=True),
    coarse=(Round(gate_m=0.12, iterations=10), Round(gate_m=0.06, iterations=10)),
    propagation=Propagation(),
    planes=PlaneSet(),
    settling=Settling(),
)

#: With planes of which somebody chose or dropped some: those chosen count, those dropped do not come back, and of the others what
#: turns out to be doubtful goes. What is left has to hold the motion.
PARTLY = replace(FULL, chosen=True)

#: With planes that somebody chose: all of them count.
CHOSEN = replace(FULL, planes=None, chosen=True)

#: The forecast's. Start values are off by what is noise in a start; those along an open direction may lie anywhere, and a
#: solve holds them at zero: either would pass for noise of the lidar, or bend what is known of the rest. What a motion knows is
#: the same a sigma or two beside its minimum: measured over 24 recordings, to 4 digits.
FORECAST = Schedule(
    motion=Round(
        gate_m=0.12, iterations=2, least_decrease=1.0, survey=False, motion_alone=True, stride=2, margin_by_noise=False
    ),
    coarse=(),
    propagation=Propagation(least_rest_s=1.0),
    planes=None,
    settling=None,
    tones=Tones(most=0),
    instead=(
        Round(gate_m=0.06, iterations=3, least_decrease=1.0, survey=False, hold=False, stride=2, margin_by_noise=False),
    ),
)
