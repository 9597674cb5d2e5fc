"""The doctor under the pipeline's name; its parts are in calib_core.doctor."""

from calib_core.doctor import DoctorReport, Forecast, ParameterForecast, inspect

__all__ = ["DoctorReport", "Forecast", "ParameterForecast", "inspect"]
