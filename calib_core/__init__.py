"""unsweep's estimator: lidar-inertial calibration from planes. `calib_core.api` has the entry points."""

__version__ = "0.2.0"
