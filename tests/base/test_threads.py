"""Two threads give the same results as one."""

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import threadpoolctl

from pipeline.base.threads import alone, both, spread
from pipeline.run import campaign_answer
from pipeline.store.campaign import dump, find


@pytest.mark.parametrize("much", [True, False])
def test_results_come_in_the_order_of_the_items(much):
    """Whichever thread is done first, the results are in the order of the items."""
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
    """The message does not depend on which file was read faster."""

    def failing(word):
        def work():
            raise ValueError(word)

        return work

    with pytest.raises(ValueError, match="first"):
        both(failing("first"), failing("second"), much)
    with pytest.raises(ValueError, match="second"):
        both(lambda: 1, failing("second"), much)
    assert both(lambda: 1, lambda: 2, much) == (1, 2)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("said", ["4", "no number"])
def test_linear_algebra_has_one_thread_whatever_the_user_has_set(said):
    """Otherwise the last digits of result.json would depend on an environment variable."""
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


def test_linear_algebra_has_one_thread_where_another_has_begun_more():
    """In nested and in concurrent blocks; the previous setting is restored after the last."""

    def threads():
        known = threadpoolctl.threadpool_info()
        return {one["num_threads"] for one in known if one["user_api"] == "blas"}

    with threadpoolctl.threadpool_limits(2), ThreadPoolExecutor(1) as other:
        begun, over = threading.Event(), threading.Event()

        def beside():
            with alone():
                begun.set()
                over.wait(10)

        with alone():
            with alone():
                assert threads() == {1}
            assert threads() == {1}
            done = other.submit(beside)
            begun.wait(10)
        assert threads() == {1}
        over.set()
        done.result()
        assert threads() == {2}


@pytest.mark.whole
def test_an_answer_does_not_hang_on_threads_of_somebody_else():
    """Byte by byte, with numpy imported with two threads, as in a Dask worker."""
    raw = find(Path(__file__).parents[2], "fanuc_r2000ic").read()
    made = []
    for number in (1, 2):
        with threadpoolctl.threadpool_limits(number):
            made.append(dump(campaign_answer("c", raw).answer.as_json()))

    assert made[0] == made[1]
