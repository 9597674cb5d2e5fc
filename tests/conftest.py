"""What every test shares: one numerical thread, real recordings where the machine has them, browser tests in a row."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

pytest_plugins = ["tests.browser"]

# Before NumPy is first imported: parallel test processes with several threads each only slow one another down.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# `make test` has compiled what there is to compile; a server under test shall not do so beside it.
os.environ.setdefault("UNSWEEP_SKIP_COMPILE", "1")

# No clock decides a test, and the same examples are tried everywhere: a failure here is a failure there.
settings.register_profile(
    "unsweep", deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("unsweep")

ROOT = Path(__file__).resolve().parent.parent
END_TO_END = Path(__file__).resolve().parent / "e2e"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the browser tests first: they are the longest chain."""
    for item in items:
        if END_TO_END in item.path.parents:
            item.add_marker(pytest.mark.e2e)
    items.sort(key=lambda item: END_TO_END not in item.path.parents)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    """Tests that must not run beside one another on one worker, all others wherever there is room.

    xdist's own marks for groups change the tests' names, which this version of pytest no longer lets it do.
    """
    return _InARow(config, log)


class _InARow(LoadScopeScheduling):
    """One scope for the browser tests, which disturb each other, one for a file whose tests share recordings or solves of its
    own, so that these are made once, and one for every other test.
    """

    def _split_scope(self, nodeid: str) -> str:
        path = nodeid.split("::", maxsplit=1)[0]
        if path.startswith("tests/e2e/"):
            return "tests/e2e/"
        return path if _shares(path) else nodeid


@cache
def _shares(path: str) -> bool:
    """Whether a file of tests has fixtures that all of its tests share."""
    return 'scope="module"' in (ROOT / path).read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of recordings of real sensors: UNSWEEP_REAL_DATA, or ../shared/data beside the repository."""
    folder = Path(os.environ.get("UNSWEEP_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recordings of real sensors at {folder}; set UNSWEEP_REAL_DATA")
    return folder
