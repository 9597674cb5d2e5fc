"""Open3D, imported where it is first used; one sentence where the machine lacks what it needs."""

from __future__ import annotations

import importlib
from types import ModuleType

from calib_core.errors import InputError

#: What `import open3d` opens beside Python packages, by Debian's names.
DEBIAN_PACKAGES = ("libegl1", "libgl1", "libx11-6", "libusb-1.0-0", "libgomp1")


def load_open3d() -> ModuleType:
    """The module. Raises InputError, naming the Debian packages, where a system library is missing."""
    try:
        module = importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise InputError(
            f"Expected Open3D to load for work on point clouds, but it did not ({_short(error)}); on Debian or Ubuntu "
            f"run `apt-get install {' '.join(DEBIAN_PACKAGES)}`, elsewhere install the same libraries.",
            code="open3d.missing",
        ) from error
    # Its warnings go to stdout, where our results go; what fails is said by us.
    module.utility.set_verbosity_level(module.utility.VerbosityLevel.Error)
    return module


def _short(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
