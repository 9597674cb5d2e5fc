"""The doctor: what a recording holds and whether it can be calibrated. Joins readers and analysis, as api does."""

from calib_core.doctor.examine import inspect
from calib_core.doctor.report import DoctorReport, Forecast, ParameterForecast

__all__ = ["DoctorReport", "Forecast", "ParameterForecast", "inspect"]
