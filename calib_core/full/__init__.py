"""The default method, in rooms in reading order; `calibrate.py` is the page that goes through them.

    run.py        what every stage shares: the recording, its clocks and noise, the choices, whom to tell
    prepare/      when readings were taken, how noisy they are
    planes/       what is flat in the clearest scan
    odometry/     the lidar followed by its planes alone
    initialise/   time offset, rotation, gravity, lever arm
    joint/        everything at once, coarse to fine
    assess/       what of it is known, and whether it can be true

A stage knows those before it, never one after it.
"""
