"""On what something was measured, for the pages that say so."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from pathlib import Path

from bench.campaign import version_label
from calib_core.threads import usable_cores


def processor() -> str:
    """The processor's name, where the system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.machine()


def measured() -> str:
    """When, which version, on what, and how busy it was: figures without are nobody's."""
    return (
        f"Measured on {datetime.now(UTC):%Y-%m-%d}, version {version_label()}, Python {platform.python_version()}, "
        f"{usable_cores()} cores, {processor()}, load average {os.getloadavg()[0]:.1f}."
    )
