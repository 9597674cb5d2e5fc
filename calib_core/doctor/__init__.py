"""The doctor: what a recording holds and whether it can be calibrated. Joins readers and analysis, as api does.

The report's models are light and wanted everywhere; `inspect` brings the estimator with it, so it is imported when it is
first asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib_core.doctor.report import DoctorReport, Forecast, ParameterForecast

if TYPE_CHECKING:
    from calib_core.doctor.examine import inspect

__all__ = ["DoctorReport", "Forecast", "ParameterForecast", "inspect"]


def __getattr__(name: str) -> object:
    if name == "inspect":
        from calib_core.doctor.examine import inspect

        return inspect
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
