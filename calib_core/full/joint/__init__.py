"""The joint estimation: one problem of knots, calibration, biases, gravity and planes, solved coarse to fine.

    solve.py        the page: `estimate_jointly`, and `estimate_motion` for the forecast
    schedule.py     which rounds, and every number that steers them
    estimation.py   what is known at one moment, as a value; begin.py makes the first, replay.py writes one down
    round.py        the steps of a round; settle.py to rest; bounds.py what may not run away
    propagate.py    over what the lidar alone could not follow: window.py, regain.py, drift.py, reach.py
    plane_set.py    planes that join and planes that leave; doubt.py says why
    problem.py      the factors: state.py, motion.py, view.py, association.py, moments.py, lidar_noise.py,
                    priors.py, undetermined.py

Each step takes what is known and gives what is known then.
"""
