"""One pool for the process, and a count of cores wherever it runs."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest

from calib_core.threads import in_parts, usable_cores, usual_threads, workers


def test_cores_are_counted_where_the_system_does_not_tell_which_may_be_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only Linux has an affinity. Mutation: ask for it everywhere."""
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    for there, expected in ((6, 6), (None, 1)):
        monkeypatch.setattr(os, "cpu_count", lambda there=there: there)
        assert usable_cores() == expected
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert usual_threads() == 4


def test_no_linear_algebra_goes_on_two_threads_the_first_time_either() -> None:
    """Seen: the first answer of a Python process ended after 46 rounds, the next after 23: SciPy's own library came in after the
    limit. Mutation: the import before it.
    """
    code = (
        "import os, numpy as np\n"
        "from calib_core.threads import one_blas_thread\n"
        "from threadpoolctl import threadpool_info\n"
        "with one_blas_thread():\n"
        "    import scipy.linalg\n"
        "    scipy.linalg.cho_factor(np.eye(3))\n"
        "    print([each['num_threads'] for each in threadpool_info() if each['user_api'] == 'blas'])\n"
    )
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    environment["OPENBLAS_NUM_THREADS"] = "3"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    threads = ast.literal_eval(done.stdout)
    assert threads
    assert set(threads) == {1}


def test_there_is_one_pool() -> None:
    """Mutation: a pool for each caller."""
    assert workers() is workers()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_child_has_a_pool_of_its_own() -> None:
    """Threads do not survive a fork: a child that waited for its parent's would wait for ever.

    Mutation: leave `register_at_fork` out.
    """
    before = workers()
    code = os.waitstatus_to_exitcode(os.waitpid(_child(before), 0)[1])
    assert code == 0


def _child(before: object) -> int:
    """A child that says with its exit code whether its pool is another one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # forking beside threads is what is tried here
        pid = os.fork()
    if pid == 0:
        os._exit(int(workers() is before))
    return pid


@pytest.mark.parametrize("count", [0, 1, 3, 4, 5, 1000])
@pytest.mark.parametrize("at_once", [1, 7, 10_000])
def test_rows_in_parts_are_each_done_once(count: int, at_once: int) -> None:
    """Mutations: the last row left out; parts that overlap; parts not waited for; more rows at once than asked for."""
    done, most = np.zeros(count, np.int64), [0]

    def one(first: int, last: int) -> None:
        time.sleep(0.0001)
        done[first:last] += 1
        most.append(last - first)

    in_parts(count, one, at_once)
    assert (done == 1).all()
    assert max(most) <= at_once


def test_what_goes_wrong_in_a_part_is_told() -> None:
    """Mutation: results of parts not asked for."""

    def one(first: int, last: int) -> None:
        if last == 100:
            raise ValueError(first)

    with pytest.raises(ValueError, match="75"):
        in_parts(100, one, 1000)
