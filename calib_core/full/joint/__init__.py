"""The joint estimation: one problem of knots, calibration, biases, gravity and planes, solved coarse to fine.

    solve.py        the page: `estimate_jointly`, and `estimate_motion` for the forecast
    schedule.py     which rounds; policies.py has the numbers of each step
    estimation.py   what is known at one moment, as a value; first_estimate.py makes the first, replay.py writes one down
    round.py        the steps of a round; alternation.py to rest; bounds.py what may not run away; state_views.py what they see
    propagate.py    over what the lidar alone could not follow: propagation_window.py, plane_reacquisition.py, drift.py,
                    plane_reach.py
    plane_choice.py which planes count, once all structure has told the motion
    plane_set.py    planes that join and planes that leave; plane_judgement.py when, doubtful_planes.py why
    problem.py      what is minimised; state.py its unknowns, lidar_factors.py, priors.py, undetermined.py
    association.py  which point lies on which plane: view.py, many_scans.py, motion.py, moments.py, lidar_noise.py

Each step takes what is known and gives what is known then. Names that go through all of them:

    data     JointData      what stays the same: the run, the knots' readings, what may become unknown
    state    Estimation     what is known at one moment: an estimate, its priors, planes, lidar noise, points given to planes
    e        Estimate       the unknowns' values alone: knots, calibration, biases, gravity, planes, sensors
    problem  JointProblem   the factors about one estimate; solved   Solved   the end of it all
    rules, sampling, settling, schedule   a step's numbers (policies.py), and which steps there are
"""
