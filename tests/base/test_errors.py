"""Errors: what they say, which of them decides, and that they survive another process."""

import itertools
import pickle

import pytest
from pydantic import Field, ValidationError

from pipeline.base import errors
from pipeline.base.errors import CannotWrite, InputError, Unfinished, UsageError
from pipeline.base.strict import Strict


def test_the_gravest_exit_code_is_returned() -> None:
    """In the order of the README: internal, disk, abandoned, usage, input, misfit, none."""
    grave = [
        1,
        CannotWrite.exit_code,
        Unfinished.exit_code,
        UsageError.exit_code,
        5,
        errors.MISFIT,
        0,
    ]
    assert grave == [1, 3, 6, 2, 5, 4, 0]
    for (k, one), (j, other) in itertools.product(enumerate(grave), repeat=2):
        assert errors.worst([one, other]) == grave[min(k, j)]
    assert errors.worst([]) == 0


def test_a_place_is_added_where_there_is_none() -> None:
    """An error keeps the file and the line that it has."""

    def raised(**own: object) -> InputError:
        with pytest.raises(InputError) as wrong, errors.at("a.csv", 7):
            raise InputError("thing", "way", **own)
        return wrong.value

    assert (raised().file, raised().line) == ("a.csv", 7)
    assert str(raised()) == "a.csv:7: thing; way."
    assert raised(line=3).line == 3
    assert (raised(file="b.csv").file, raised(file="b.csv").line) == ("b.csv", None)
    parts = raised(passing=True, key=("tool", 0)).parts
    assert (parts["thing"], parts["way_out"], parts["line"]) == ("thing", "way", 7)
    assert (parts["passing"], parts["key"]) == (True, ["tool", 0])


@pytest.mark.parametrize(
    "one", [InputError("a", "b?", file="c", line=2, passing=True), Unfinished("a", "b")]
)
def test_an_error_survives_another_process(one: errors.PipelineError) -> None:
    """With its sentence, parts and exit code."""
    back = pickle.loads(pickle.dumps(one))
    assert (str(back), vars(back), back.exit_code) == (str(one), vars(one), one.exit_code)


def test_a_sentence_ends_once() -> None:
    """With the sign that it has, or a full stop; foreign characters control nothing."""
    assert [errors.ended(one) for one in ("a", "a.", "a?", "a!")] == ["a.", "a.", "a?", "a!"]
    assert str(UsageError("\x1b[2J")) == "\\x1b[2J."


@pytest.mark.parametrize(
    ("count", "most", "text"),
    [
        (0, 12, "none"),
        (3, 12, "n0, n1, n2"),
        (12, 12, ", ".join(f"n{k}" for k in range(12))),
        (13, 12, ", ".join(f"n{k}" for k in range(12)) + " and 1 more"),
        (5, 2, "n0, n1 and 3 more"),
    ],
)
def test_names_are_listed_up_to_a_number(count: int, most: int, text: str) -> None:
    """The others are counted."""
    assert errors.listed((f"n{k}" for k in range(count)), most) == text


def test_a_place_is_file_and_line() -> None:
    """As compilers write it."""
    assert errors.place(None, 3) == ""
    assert errors.place("a", None) == "a: "
    assert errors.place("a", 3) == "a:3: "


class Inner(Strict):
    """A table."""

    x: int


class File(Strict):
    """A file with an entry of each kind."""

    at: tuple[float, float] = (0.0, 0.0)
    few: list[int] = Field([1, 2], min_length=2, max_length=3)
    name: str = Field("a", pattern="^[a-z]+$")
    word: str = Field("a", pattern="^[a-z_.-]+$")
    size: float = Field(1.0, ge=1, lt=5)
    inner: Inner = Inner(x=1)


@pytest.mark.parametrize(
    ("content", "path", "said"),
    [
        ({"at": [1.0]}, ["at", "1"], "value 2 is missing"),
        ({"inner": {}}, ["inner", "x"], "is missing"),
        ({"inner": {"y": 2}}, ["inner", "y"], "unknown key"),
        ({"size": 9, "sice": 2}, ["sice"], "unknown key"),
        ({"inner": 3}, ["inner"], "should be a table"),
        ({"few": 3}, ["few"], "should be a list in square brackets"),
        ({"name": 3}, ["name"], "should be text in quotation marks"),
        ({"few": [1]}, ["few"], "there are 1 here and at least 2 are needed"),
        ({"few": [1] * 4}, ["few"], "there are 4 here and at most 3 are needed"),
        ({"name": "A"}, ["name"], '"A" is not a name of letters and digits'),
        ({"word": "A"}, ["word"], '"A" is not a name of letters, digits, dots'),
        ({"size": 0.5}, ["size"], "0.5 should be at least 1"),
        ({"size": 5}, ["size"], "5 should be less than 5"),
        ({"size": "big"}, ["size"], '"big" should be a number'),
        ({"inner": {"x": 1.5}}, ["inner", "x"], "1.5 should be a whole number"),
    ],
)
def test_what_is_wrong_with_an_entry_is_said_in_words_of_the_file(
    content: dict[str, object], path: list[str], said: str
) -> None:
    """With its path; an unknown key decides, as it may be another one misspelt."""
    with pytest.raises(ValidationError) as wrong:
        File.model_validate(content)
    where, message = errors.first_wrong(wrong.value)
    assert where == path
    assert message.startswith(said)
