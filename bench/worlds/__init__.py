"""A second simulator, that shares nothing with calib_core: its own places, motions, sensors, faults and bags.

What the estimator is held against by `calib_core.simulate` was written beside it. Here is what it was not: streets with poles and
cars, tents without a right angle, offices full of boxes, arms that stop and go, drones, heel strikes, mountings drawn at random.

    draw.py: a seed's world -> places.py, motions.py -> lidars.py, imus.py, faults.py -> bags.py: a ROS 1 bag and its truth

`python -m bench.worlds --seeds 1-40` (`__main__.py`) draws, solves and compares.
"""
