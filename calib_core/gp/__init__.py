"""Gaussian-process regression over time: kernels, posterior in windows, training, noise level. No IMU in here."""

from calib_core.gp.kernels import Smoothness
from calib_core.gp.noise import high_frequency_noise
from calib_core.gp.regression import Hyper, posterior_of_windows, windowed_posterior
from calib_core.gp.training import fit_hyper, train_windows

__all__ = [
    "Hyper",
    "Smoothness",
    "fit_hyper",
    "high_frequency_noise",
    "posterior_of_windows",
    "train_windows",
    "windowed_posterior",
]
