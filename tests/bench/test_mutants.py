"""Bugs planted at random: drawn from a seed, in one place, and noticed by a test that sees them."""

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

from bench.mutants import play
from bench.mutants.draw import bug, functions

SOURCE = textwrap.dedent(
    '''
    """A module."""

    from functools import lru_cache

    LIMIT = 3


    @lru_cache(maxsize=4)
    def halves(n):
        return half(n), half(n)


    def half(n):
        return n / 2


    def third(n):
        return n / 3


    class Box:
        @property
        def volume(self):
            return self.a * self.b - LIMIT


    def nearest(values, at):
        """The value next to a place."""
        far = [abs(v - at) for v in values if v is not None]
        return None if not far else values[min(range(len(far)), key=lambda n: far[n])]
    '''
)

TEST = textwrap.dedent(
    """
    import pytest
    from pipelet.room.lengths import Box, halves, nearest, third

    THREE = third(9.0)


    @pytest.fixture(scope="module")
    def box():
        return Box()


    def test_the_nearest_value():
        assert nearest([1.0, 4.0, 9.0], 5.0) == 4.0


    def test_a_box(box):
        box.a, box.b = 2, 5
        assert box.volume == 7


    def test_the_same_box(box):
        assert isinstance(box, Box)


    def test_halves():
        assert halves(8.0) == (4.0, 4.0)


    def test_halves_again():
        assert halves(8.0)[0] == 4.0


    def test_a_third():
        assert THREE == 3.0
    """
)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with one room of one module, and a test of it beside it."""
    room = tmp_path / "pipelet" / "room"
    room.mkdir(parents=True)
    (room / "lengths.py").write_text(SOURCE)
    for folder in (room, room.parent):
        (folder / "__init__.py").write_text("")
    (tmp_path / "test_lengths.py").write_text(TEST)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    return room.parent


def test_sites_are_in_functions_and_not_in_strings() -> None:
    found = {name: [site.kind for site in sites] for name, _, sites in functions(SOURCE)}
    assert found["Box.volume"] == ["operator", "operator"]
    assert sorted(found["nearest"]) == sorted(
        ["filter dropped", "comparison", "operator", "branches exchanged", "not", "function"]
    )


def test_a_length_that_follows_from_the_others_is_no_site() -> None:
    """Any negative number means the same to numpy."""
    source = "def f(a):\n    return a[-1].reshape(3, -1) - a.sum(-1)"
    kinds = [site.kind for _, _, sites in functions(source) for site in sites]
    assert sorted(kinds) == ["number", "number", "number", "operator"]


def test_an_argument_that_only_checks_is_no_site() -> None:
    source = "def f(a, b):\n    return zip(a.sum(keepdims=True), b, strict=True)"
    ((_, _, sites),) = functions(source)
    assert [site.kind for site in sites] == ["flag"]


def test_a_bug_is_one_changed_statement_of_its_seed(package: Path) -> None:
    every = [bug(package, "room", seed) for seed in range(20)]
    assert bug(package, "room", 3) == every[3]
    assert len({one.after for one in every}) > 5
    for one in every:
        assert one.before != one.after
        compile(one.source, one.file, "exec")
        without = one.source.replace(one.after.splitlines()[0].strip(), "", 1)
        assert without != one.source


@pytest.mark.whole
@pytest.mark.parametrize(
    ("old", "new", "code"),
    [("", "", 0), ("b - LIMIT", "b + LIMIT", 1), ("v - at", "v + at", 1), ("/ 3", "* 3", 1)],
    ids=["no bug", "in a property", "in a function", "before any test"],
)
def test_a_planted_bug_fails_the_test_that_sees_it(
    package: Path, old: str, new: str, code: int
) -> None:
    (package.parent / "changed.txt").write_text(SOURCE.replace(old, new))
    told = _by_itself(
        "partial(play.tested_with, Path('changed.txt').read_text(), 'pipelet.room.lengths', TESTS)"
    )
    assert told == code


@pytest.mark.whole
def test_each_test_is_known_by_the_functions_that_it_enters(package: Path) -> None:
    told = _by_itself("partial(play.reached, Path('pipelet').resolve(), TESTS)")
    lines = SOURCE.splitlines()
    volume = f"room/lengths.py:{1 + lines.index('    @property')}"
    nearest = f"room/lengths.py:{1 + lines.index('def nearest(values, at):')}"
    entered = {name.partition("::")[2]: set(one["of"]) for name, one in told.items()}
    assert nearest in entered["test_the_nearest_value"]
    assert volume in entered["test_a_box"]
    assert not {nearest, volume} & entered["test_the_same_box"]


@pytest.mark.whole
def test_what_is_entered_once_counts_for_all_that_rest_on_it(package: Path) -> None:
    """A cache filled by another test, and what the file of tests computes when it is imported."""
    told = _by_itself("partial(play.reached, Path('pipelet').resolve(), TESTS)")
    lines = SOURCE.splitlines()
    cache, half, third = (
        f"room/lengths.py:{1 + lines.index(line)}"
        for line in ("@lru_cache(maxsize=4)", "def half(n):", "def third(n):")
    )
    entered = {name.partition("::")[2]: set(one["of"]) for name, one in told.items()}
    for name in ("test_halves", "test_halves_again"):
        assert {cache, half} <= entered[name]
    assert not {cache, half} & entered["test_a_box"]
    assert all(third in of for of in entered.values())


def _by_itself(work: str) -> Any:
    """Told by a player that is no test: pytest within pytest shares its modules."""
    code = (
        "import json; from functools import partial; from pathlib import Path\n"
        "from bench.mutants import play\n"
        "TESTS = ['test_lengths.py']\n"
        f"print(json.dumps(play.apart({work}, 60)))"
    )
    root = Path(__file__).parents[2]
    paths = os.pathsep.join([str(Path.cwd()), str(root)])
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def test_what_never_ends_is_stopped() -> None:
    assert play.apart(_endless, 0.5) is None


def _endless() -> None:
    while True:
        pass
