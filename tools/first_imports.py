"""Import what only the server needs, so that Python keeps its bytecode before anybody waits for it.

The Makefile installs packages without their bytecode, most of which nobody ever runs. What a calibration imports gets its own
while its loops are compiled.
"""

import importlib
from contextlib import suppress

# The server with all its pages; what the processes of its jobs begin with; what files of clouds are read and written by.
SERVED = ("app.cli.serving", "app.work.ready", "open3d")


def import_all() -> None:
    """Import it. Where a part is missing or broken, whoever needs that part says so."""
    for name in SERVED:
        with suppress(Exception):
            importlib.import_module(name)
    with suppress(Exception):
        importlib.import_module("app.scene.apply").warm_up()


if __name__ == "__main__":
    import_all()
