"""The door to jobs for a process that is forked (app/children.py): with it comes, once, all that jobs import on their way.

There on one thread: of others, what is forked would have the locks that they held, and nobody to open them.
"""

from __future__ import annotations

import importlib
from contextlib import suppress

from app.children import FORKED
from app.work.functions import run_job
from calib_core import api

__all__ = ["run_job"]

# Where something of it is missing or broken, the job that needs it says so.
with suppress(Exception):
    api.get_ready(aside=not FORKED)
    for _name in (
        "calib_core.full.odometry.reference_cloud",
        "calib_core.doctor.examine",
        "calib_core.doctor.outlook",
        "calib_core.full.forecast_by_choice",
    ):
        importlib.import_module(_name)
