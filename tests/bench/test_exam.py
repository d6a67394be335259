"""The frame of exams, with a game of plain numbers."""

import math

import pytest

from bench.exam import JSON, Kept, between, code_of, contest, seeds
from pipeline.base.errors import InputError, Interrupted
from pipeline.service.executor import InThisProcess, ItemResult


def square(number):
    """A game: a number and its square, and a row that is infinite."""
    return {"square": number**2, "far": math.inf}


def code():
    """Version of the game."""
    return "mine"


def kept_in(path, by="mine"):
    """The file of a contest."""
    return Kept(path, by, JSON)


def played(path, wanted, executor=None, **how):
    """Squares of these numbers."""
    kept = kept_in(path, how.pop("by", "mine"))
    return contest(wanted, square, str, code, kept, executor or InThisProcess(), **how)


def test_rows_come_back_in_the_order_asked_for(tmp_path):
    """Also infinite values, and from the file."""
    wanted = [3, 1, 2]

    first = played(tmp_path / "a" / "log", wanted)

    assert [row["square"] for row in first] == [9, 1, 4]
    assert played(tmp_path / "a" / "log", wanted, minutes=0) == first
    assert first[0]["far"] == math.inf


def test_only_what_is_missing_is_played(tmp_path, monkeypatch):
    """Neither rows that are kept; but a line that was cut off is played again."""
    log = tmp_path / "log"
    played(log, [1, 2])
    log.write_text(log.read_text()[:-5])

    class Counting(InThisProcess):
        def results(self, work, items):
            asked.extend(items := list(items))
            return super().results(work, items)

    asked = []
    played(log, [1, 2, 3], Counting())

    assert asked == [2, 3]
    assert len(log.read_text().splitlines()) == 3


def test_rows_of_other_code_stay_and_do_not_count(tmp_path):
    """Those of the present code stand beside them."""
    log = tmp_path / "log"
    kept_in(log, "older").add("1", {"square": -1})

    (row,) = played(log, [1])

    assert row["square"] == 1
    assert kept_in(log, "older").rows() == {"1": {"square": -1}}


def test_code_that_changes_on_the_way_is_refused(tmp_path):
    """A row is not kept under the version of another process."""
    with pytest.raises(InputError, match="changed on the way"):
        played(tmp_path / "log", [1], by="before")

    assert not (tmp_path / "log").exists()


def test_what_an_interrupted_contest_has_is_kept(tmp_path):
    """It says how many games of all there are."""

    class Broken(InThisProcess):
        def results(self, work, items):
            yield ItemResult(1, work(1))
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="1 of 3 games"):
        played(tmp_path / "log", [1, 2, 3], Broken())

    assert [*kept_in(tmp_path / "log").rows()] == ["1"]


def test_no_game_is_begun_after_the_time(tmp_path):
    """But the first one is."""
    assert len(played(tmp_path / "log", [1, 2, 3], minutes=1e-9)) == 1


def test_a_file_of_seeds_is_read_from_a_place_on(tmp_path):
    """One that is too short is refused with both numbers."""
    path = tmp_path / "seeds.txt"
    path.write_text("11 12\n13\n")

    assert seeds(path, 1, 2) == [12, 13]
    with pytest.raises(InputError, match="holds 3 seeds, and game 4 is asked for"):
        seeds(path, 2, 2)


def test_code_is_what_stands_in_the_files(tmp_path):
    """In whatever order they are named."""
    a, b = tmp_path / "a.py", tmp_path / "b.py"
    a.write_text("1")
    b.write_text("2")
    before = code_of([a, b])

    assert code_of([b, a]) == before
    b.write_text("3")
    assert code_of([a, b]) != before


def test_text_by_hand_stays_around_what_is_written():
    """Also if a page has no mark yet."""
    page = between("above\n", "<!-- here -->", "one")

    again = between(f"{page}below\n", "<!-- here -->", "two")

    assert again.startswith("above\n<!-- here -->\ntwo\n")
    assert again.endswith("below\n")
    assert "one" not in again
