"""Work on two threads gives what it gives on one."""

import threading

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
