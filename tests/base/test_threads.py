"""Work on two threads gives what it gives on one."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from pipeline.base.threads import both, spread


@pytest.mark.parametrize("much", [True, False])
def test_results_come_in_the_order_of_the_items(much):
    """Whichever thread is done first, the first item's result stands first."""
    second_done = threading.Event()

    def work(item):
        if item == 1 and much:
            assert second_done.wait(10)
        if item == 2:
            second_done.set()
        return 10 * item

    assert spread(work, [1, 2, 3], much) == [10, 20, 30]


@pytest.mark.parametrize("much", [True, False])
def test_where_both_fail_the_first_is_heard(much):
    """What the user is told does not depend on which file was read faster."""

    def failing(word):
        def work():
            raise ValueError(word)

        return work

    with pytest.raises(ValueError, match="first"):
        both(failing("first"), failing("second"), much)
    with pytest.raises(ValueError, match="second"):
        both(lambda: 1, failing("second"), much)
    assert both(lambda: 1, lambda: 2, much) == (1, 2)


@pytest.mark.parametrize("said", ["4", "no number"])
def test_linear_algebra_has_one_thread_whatever_the_user_has_set(said):
    """Else the last digits of result.json would depend on a variable of somebody's shell."""
    code = (
        "import pipeline.app.cli, numpy, scipy.linalg, threadpoolctl\n"
        "print({one['num_threads'] for one in threadpoolctl.threadpool_info()})"
    )
    libraries = ("OPENBLAS", "GOTO", "OMP", "MKL")
    environment = os.environ | {f"{library}_NUM_THREADS": said for library in libraries}
    here = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=here,
        env=environment,
    )

    assert done.stdout == "{1}\n"
