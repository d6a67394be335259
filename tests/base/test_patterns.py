"""Globs and expressions of campaign.toml: what they match, against brute force and Python's own."""

import itertools
import re

import pyarrow as pa
import pytest

from pipeline.base import patterns

NAMES = ["a", "b.csv", "ab"]
PATHS = ["/".join(path) for n in (1, 2, 3) for path in itertools.product(NAMES, repeat=n)]


def as_expression(glob: str) -> re.Pattern[str]:
    """A glob as Python's expression: * within a folder, ** for any number of folders."""
    letters = {"*": "[^/]*", "?": "[^/]"}
    whole = ""
    for part in glob.split("/"):
        if part == "**":
            whole += "(?:[^/]+/)*"
        else:
            whole += "".join(letters.get(one, re.escape(one)) for one in part) + "/"
    return re.compile(whole)


@pytest.mark.parametrize(
    "glob",
    [
        "a",
        "*",
        "*.csv",
        "?",
        "a/*",
        "*/b.csv",
        "**/a",
        "**/*.csv",
        "a/**/a",
        "**/a/**/b.csv",
        "*/**/*",
    ],
)
def test_a_glob_fits_what_it_says(glob: str) -> None:
    """Every path of up to three parts, against an expression."""
    expression = as_expression(glob)
    found = [path for path in PATHS if patterns.fits(path, glob)]

    assert found == [path for path in PATHS if expression.fullmatch(f"{path}/")]
    assert 0 < len(found) < len(PATHS)
    assert max(path.count("/") + 1 for path in found) <= patterns.depth(glob, 3)


def test_folders_alone_are_no_files() -> None:
    """A glob that ends with ** names folders; it matches no file."""
    assert not patterns.fits("a/b.csv", "a/**")
    assert not patterns.fits("a", "**")


@pytest.mark.parametrize(
    ("glob", "depth"), [("*.csv", 1), ("a/*", 2), ("a/b/c/d", 3), ("**/a", 3), ("**", 3)]
)
def test_folders_are_searched_no_deeper_than_a_glob_reaches(glob: str, depth: int) -> None:
    """Its own parts, or all of them where it has **."""
    assert patterns.depth(glob, 3) == depth


@pytest.mark.parametrize(
    ("name", "several"), [("a*", True), ("a?", True), ("[ab]", True), ("ab", False)]
)
def test_a_name_with_a_mark_may_be_several_files(name: str, several: bool) -> None:
    """Each of the marks by itself."""
    assert patterns.is_glob(name) is several


def test_numbers_in_names_are_sorted_by_size() -> None:
    """The tenth pose comes after the second."""
    names = ["pose10", "pose2", "pose1b", "pose1", "pose2_rep11", "pose2_rep3"]
    assert sorted(names, key=patterns.natural) == [
        "pose1",
        "pose1b",
        "pose2",
        "pose2_rep3",
        "pose2_rep11",
        "pose10",
    ]


def test_parts_of_names_are_those_of_pythons_expressions() -> None:
    """Complete matches only; null elsewhere; another alternative fills an empty part."""
    expression = r"(?P<pose>\d+)_(?P<what>[\w-]+)"
    names = ["12_zero", "3_a-b", "12_zero ", "x1_z", "4_\N{LATIN SMALL LETTER U WITH DIAERESIS}b"]
    found = patterns.parts(pa.array(names), expression).to_pylist()
    expected = [re.fullmatch(expression, one) for one in names]

    assert found == [one and one.groupdict() for one in expected]
    either = patterns.parts(pa.array(["p7", "7q", "7"]), r"p(?P<pose>\d)|(?P<pose_2>\d)q")
    assert either.to_pylist() == [{"pose": "7"}, {"pose": "7"}, None]


def test_a_name_is_matched_up_to_its_bound() -> None:
    """200 characters, and not one more."""
    names = pa.array(["a" * 200, "a" * 201])
    assert patterns.parts(names, "(?P<all>a+)").to_pylist() == [{"all": "a" * 200}, None]


def test_the_named_parts_are_those_of_the_expression() -> None:
    """In any order; without names none."""
    assert patterns.named(r"(?P<pose>\d+)-(?P<target>.*)") == {"pose", "target"}
    assert patterns.named("abc") == set()


@pytest.mark.parametrize(
    ("expression", "why"),
    [
        ("(?P<a>x", "not a regular expression of RE2"),
        ("(?=x)", "no look-around"),
        ("(?P<a>x)|(?P<a>y)", "not a regular expression"),
        ("a" * 301, "more than 300 letters"),
        ("a{601}", "more than 300 letters"),
        ("(ab){301}", "more than 300 letters"),
        ("((ab{10}c){10}){6}", "more than 300 letters"),
        ("x" * 99 + "[abc]{502}", "more than 300 letters"),
    ],
)
def test_an_expression_that_cannot_be_used_is_refused(expression: str, why: str) -> None:
    """As it is written, or as it is with all repetitions written out."""
    with pytest.raises(ValueError, match=why):
        patterns.named(expression)


@pytest.mark.parametrize(
    "expression",
    ["a" * 300, "a{600}", "(ab){300}", "((ab{10}c){10}){5}", "a{3,600}", "x" * 99 + "[abc]{501}"],
)
def test_an_expression_within_the_bound_is_used(expression: str) -> None:
    """600 characters with all repetitions written out: (ab{10}c) has twelve, ten of them 120."""
    assert patterns.named(expression) == set()
