"""Work in one process or several: the same results, nothing lost, nothing left behind."""

import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from pipeline.base.errors import InputError, Unfinished
from pipeline.service.executor import InProcesses, InThisProcess, in_order

BOTH = pytest.mark.parametrize(
    "executor", [InThisProcess(), InProcesses(2)], ids=["here", "processes"]
)


def halved(number):
    if number == 3:
        raise InputError("three is odd", "take four", file="numbers.csv", line=7)
    if number == 5:
        raise KeyError("five")
    return number / 2


@BOTH
def test_every_item_comes_back_with_its_value_or_its_problem(executor):
    """Whoever fails stops none of the others; an error keeps its parts on the way."""
    found = {done.item: done for done in executor.results(halved, range(8))}

    assert {k: done.value for k, done in found.items()} == {
        0: 0.0, 1: 0.5, 2: 1.0, 3: None, 4: 2.0, 5: None, 6: 3.0, 7: 3.5,
    }  # fmt: skip
    refused = found[3].problem
    assert (refused.file, refused.line, refused.thing) == ("numbers.csv", 7, "three is odd")
    with pytest.raises(KeyError, match="five"):
        raise found[5].problem


@BOTH
def test_results_can_be_had_in_the_order_of_the_items(executor):
    """However long each takes; the first that fails is heard."""
    assert in_order(executor, slowly, [0.4, 0.0, 0.1]) == [0.4, 0.0, 0.1]
    with pytest.raises(InputError, match="three is odd"):
        in_order(executor, halved, range(6))


def slowly(seconds):
    time.sleep(seconds)
    return seconds


def test_a_problem_says_where_it_has_happened():
    """The place in the other process, which the traceback here does not reach."""
    (done,) = InProcesses(1).results(halved, [5])

    assert "in halved" in done.problem.__notes__[0]


def test_a_value_that_cannot_travel_is_its_own_problem():
    """And the next item is worked on as if nothing had been."""
    first, second = InProcesses(1).results(maybe_a_function, [True, False])

    assert "maybe_a_function" in str(first.problem)
    assert second.result is None


def maybe_a_function(wanted):
    return (lambda: None) if wanted else None


def test_items_are_taken_when_there_is_room_for_them():
    """Campaigns that wait are not held open."""
    taken = []

    def items():
        for number in range(9):
            taken.append(number)
            yield number

    results = InProcesses(2).results(slowly, items())
    for ended in range(1, 4):
        next(results)
        assert len(taken) <= 2 + ended
    results.close()

    assert len(taken) < 9


def begun(folder, item):
    """How often an item has been begun, this time included."""
    with (folder / str(item)).open("a") as note:
        note.write(f"{os.getpid()}\n")
    return len((folder / str(item)).read_text().split())


def dies(folder, times, item):
    """Its process is killed while it is at work, the first few times."""
    if begun(folder, item) <= times.get(item, 0):
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return item * item


def test_an_item_whose_process_was_killed_is_begun_again(tmp_path):
    """Twice at most; nothing is lost, and nothing of the others is done twice."""
    found = list(InProcesses(2).results(partial(dies, tmp_path, {1: 2, 4: 1}), range(6)))

    assert sorted((done.item, done.result) for done in found) == [(k, k * k) for k in range(6)]
    often = [len((tmp_path / str(k)).read_text().split()) for k in range(6)]
    assert often == [1, 3, 1, 1, 2, 1]


@pytest.mark.whole
def test_an_item_that_always_kills_its_process_is_given_up(tmp_path):
    """After three processes it is that item's failure, and nobody else's."""
    found = {d.item: d for d in InProcesses(2).results(partial(dies, tmp_path, {2: 99}), range(5))}

    assert sorted(k for k, done in found.items() if done.problem is None) == [0, 1, 3, 4]
    with pytest.raises(Unfinished, match="was killed"):
        raise found[2].problem
    assert len((tmp_path / "2").read_text().split()) == 3


def test_who_stops_listening_leaves_no_process(tmp_path):
    """Ctrl-C in the middle of a contest, say: what is at work is ended at once."""
    results = InProcesses(2).results(partial(sleeping, tmp_path), range(5))
    next(results)
    began = time.monotonic()
    results.close()

    assert time.monotonic() - began < 5
    for pid in {int(word) for note in tmp_path.iterdir() for word in note.read_text().split()}:
        assert not Path(f"/proc/{pid}").exists() or "(zombie)" in status(pid)


def status(pid):
    return Path(f"/proc/{pid}/status").read_text()


def sleeping(folder, item):
    begun(folder, item)
    time.sleep(0.0 if item == 0 else 60.0)
