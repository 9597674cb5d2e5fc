"""The doctor's report as the wire carries it: calib_core's own model, untouched."""

from __future__ import annotations

from calib_core.doctor.report import DoctorReport

Report = DoctorReport
