"""The Cramér-Rao bound of a simulated recording: what no unbiased estimator can beat, from the truth alone.

It is the oracle that the estimator's efficiency is measured against, so it shares nothing with it but the simulator: no
factor, no solver, no binning of calib_core.

Model. Everything is linearised about the true motion in the simulator's own world. Unknown are the motion, the 7
calibration parameters, gravity (3, its magnitude with the contract's prior), both biases (constants, or random walks where
the scenario's walk) and three numbers a plane. Known are the noise levels. Every return from a plane is one measurement of
a range along a known ray; returns from furniture and people are left out, since nothing is known of their shape. The IMU
measures angular rate and specific force with white noise of its density.

    motion.py     how errors of the motion grow between instants
    lidar.py      one row a return
    eliminate.py  a square-root information filter over the instants, by QR only
    blocks.py     what real sensors add, as further unknowns
    bound.py      the bound of a scenario
"""

from bench.bound.blocks import Blocks
from bench.bound.bound import Bound, bound_of, with_parameters
from bench.bound.model import Assumptions

__all__ = ["Assumptions", "Blocks", "Bound", "bound_of", "with_parameters"]
