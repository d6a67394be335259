"""Foreign text in terminals, JSON and TOML; preferences, doors, and addresses."""

import io
import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pydantic import TypeAdapter, ValidationError

from pipeline.base import doors, environment, language, shown, strict, toml
from pipeline.base.appearance import Appearance
from pipeline.base.arrays import sifted
from pipeline.base.errors import InputError, UsageError
from pipeline.house.appearances import appearances
from pipeline.library import preferences

ODD = ["\x00", "\x1b", "\x7f", "\x9f", "\xad", "\u202e", "\u2028", "\udc80", "\udcff", "\ud800"]
ODD += ["\ufeff", "\U000e0001"]


def test_every_odd_character_is_written_as_python_does() -> None:
    """By its code in two, four or eight digits; a byte that was no text as that byte."""
    for one in ODD:
        bytes_ = one.encode("utf-8", "surrogateescape") if "\udc80" <= one <= "\udcff" else b""
        expected = f"\\x{bytes_[0]:02x}" if bytes_ else one.encode("unicode_escape").decode()
        assert shown.printable(f"a{one}b") == f"a{expected}b"
        assert not shown.is_printable(one)
    assert shown.printable("\n\r\t") == "\\n\\r\\t"
    assert shown.lines("a\n\x1b") == "a\n\\x1b"
    assert shown.is_printable("ä – µ ✓")


@pytest.mark.parametrize("most", [10, 11, 12, 50])
def test_a_long_text_is_shown_by_its_ends(most: int) -> None:
    """As many characters as allowed, the first ones and the last ones; a short one whole."""
    for text in ("a" * most, "ab"):
        assert shown.printable(text, most) == text
    for text in ("".join(map(str, range(most + 5))), "x" * (2 * most + 1) + "end"):
        told = shown.printable(text, most)
        head, tail = told.split(" … ")
        assert len(told) == most
        assert text.startswith(head)
        assert text.endswith(tail)
        assert len(tail) == most // 3


def test_json_and_toml_read_back_what_was_written() -> None:
    """Every odd character, except half a character in TOML; the file itself has none of them."""
    for one in ODD:
        text = f'a{one}"\\\n'
        dumped = shown.in_json({"k": [text]}, indent=1)
        assert json.loads(dumped) == {"k": [text]}
        assert shown.is_printable(dumped.replace("\n", ""))
        written = shown.in_toml(text)
        assert shown.is_printable(written)
        whole = text if one < "\ud800" or one > "\udfff" else text.replace(one, "\ufffd")
        assert tomllib.loads(f"k = {written}") == {"k": whole}
    assert shown.in_json({"ä": 1}) == '{"ä": 1}'
    with pytest.raises(ValueError, match="JSON"):
        shown.in_json(np.nan)


def test_a_line_goes_to_the_screen_that_is_given(capsys: pytest.CaptureFixture[str]) -> None:
    """Or to stdout; a disk that is full does not matter."""
    own = io.StringIO()
    shown.say("a", own)
    shown.say("b\x1b")

    assert own.getvalue() == "a\n"
    assert capsys.readouterr().out == "b\\x1b\n"


class Full(io.StringIO):
    """A screen on a full disk."""

    def write(self, text: str) -> int:
        """No space."""
        raise OSError(28, "No space left on device")


def test_a_line_that_finds_no_space_is_lost() -> None:
    """The run goes on."""
    shown.say("a", Full())


def test_sizes_are_in_the_unit_of_their_bound() -> None:
    """Mebibytes below a gigabyte, gigabytes from there on."""
    assert shown.too_large(3 * 2**20, 2**20) == "has 3.0 MiB, more than the 1 MiB that are read"
    assert shown.too_large(3 * 10**9, 10**9) == "has 3.0 GB, more than the 1 GB that are read"


def test_tables_are_merged_and_empty_changes_left_out() -> None:
    """Inner tables too; lists and values are replaced."""
    old = {"a": {"x": 1, "y": {"z": 2}}, "b": [1], "c": 3, "d": 4}
    new = {"a": {"y": {"w": 5}}, "b": [2], "c": {"k": 6}, "e": 7}
    assert toml.merged(old, new) == {
        "a": {"x": 1, "y": {"z": 2, "w": 5}},
        "b": [2],
        "c": {"k": 6},
        "d": 4,
        "e": 7,
    }
    assert old["a"] == {"x": 1, "y": {"z": 2}}
    changes = {"a": None, "b": {"c": None, "d": {}}, "e": 0, "f": {"g": False, "h": None}, "i": []}
    assert toml.given(changes) == {"e": 0, "f": {"g": False}, "i": []}


def test_a_place_in_toml_is_added_to_an_error() -> None:
    """File and line of its key; another file, or a line that it has, stays."""
    text = "[tool]\na = 1\n\n[joints]\nfile = 'x'\n"

    def raised(**own: object) -> tuple[str | None, int | None]:
        with pytest.raises(InputError) as wrong, toml.placed("c.toml", text):
            raise InputError("thing", "way", **own)
        return wrong.value.file, wrong.value.line

    assert raised() == ("c.toml", None)
    assert raised(key=("joints", "file")) == ("c.toml", 5)
    assert raised(key=("joints", "file"), line=2) == ("c.toml", 2)
    assert raised(key=("joints", "file"), file="c.toml") == ("c.toml", 5)
    assert raised(key=("joints", "file"), file="d.csv") == ("d.csv", None)
    assert raised(file="d.csv", line=3) == ("d.csv", 3)


@pytest.mark.parametrize(
    ("text", "line", "remedy"),
    [
        ("a = 1\nb = 1,5\n", 2, "write numbers with a decimal point"),
        ("a = 1\nb = [-0,5 5]\n", 2, "write numbers with a decimal point"),
        ("a = 1\nb = = 2\n", 2, "correct that place"),
        ("a = 1\nb = [0,0,.1]\n", 2, "correct that place"),
        ("a = 1,5\nb = = 2\n", 1, "write numbers with a decimal point"),
    ],
)
def test_where_toml_ends_is_said_with_its_remedy(text: str, line: int, remedy: str) -> None:
    """A decimal comma is the usual slip of a European keyboard."""
    with pytest.raises(InputError, match="not valid TOML") as wrong:
        toml.loads(text, "c.toml")
    assert (wrong.value.file, wrong.value.line) == ("c.toml", line)
    assert wrong.value.way_out == remedy
    assert toml.remedy(text, None, "look") == "look"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f"a = 1\nb = {2**63}\n", 2),
        (f"[t]\nb = [1, {10**30}]\n", 2),
        (f"[[t]]\na = 1\n[[t]]\na = {10**30}\n", 4),
    ],
)
def test_a_number_of_more_than_64_bits_is_named_with_its_line(text: str, line: int) -> None:
    """Also in a list, and in one of several tables."""
    with pytest.raises(InputError, match="more than 64 bits") as wrong:
        toml.loads(text, "c.toml")
    assert wrong.value.line == line
    with pytest.raises(InputError, match=r"valid TOML \(a number of thousands of digits\)"):
        toml.loads(f"a = {'1' * 5000}\n", "c.toml")


def test_rows_are_selected_in_every_kind_of_column() -> None:
    """numpy, Arrow, and a column that is not there."""
    good = np.array([True, False, True])
    found = sifted({"a": np.arange(3), "b": pa.array([1, 2, 3]), "c": None}, good)

    assert found["a"].tolist() == [0, 2]
    assert found["b"].to_pylist() == [1, 3]
    assert found["c"] is None


def test_a_door_is_there_if_its_package_is() -> None:
    """Without it the offer is missing, with a reason; an error inside is one of the program."""
    there, away = "pipeline.house.catalogue:translator", "pipeline.nowhere.part:thing"

    assert doors.is_there(there)
    assert not doors.is_there(away)
    assert doors.opened(there) is doors.found(there) is not None
    assert doors.found(away) is None
    with pytest.raises(UsageError, match=r"without pipeline\.nowhere: install"):
        doors.opened(away)
    with pytest.raises(ModuleNotFoundError):
        doors.opened("pipeline.house.no_such_module:thing")


def test_an_empty_folder_is_no_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a package that was removed leaves behind."""
    (tmp_path / "left" / "behind").mkdir(parents=True)
    (tmp_path / "left" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)

    assert not doors.is_there("left.behind.part:thing")
    (tmp_path / "left" / "behind" / "__init__.py").touch()
    assert doors.is_there("left.behind.part:thing")


@pytest.mark.parametrize(
    ("lower", "upper", "said"),
    [
        (None, None, "127.0.0.1,localhost"),
        ("a.b", "c.d", "a.b,127.0.0.1,localhost"),
        (None, "c.d", "c.d,127.0.0.1,localhost"),
    ],
)
def test_this_machine_is_reached_without_a_proxy(
    lower: str | None, upper: str | None, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In addition to what the user has excluded."""
    for name, value in (("no_proxy", lower), ("NO_PROXY", upper)):
        monkeypatch.delenv(name, raising=False)
        if value is not None:
            monkeypatch.setenv(name, value)
    assert environment.unproxied() == {"no_proxy": said}


def test_the_folder_is_another_within_the_block_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also after an error; a folder that was removed is not returned to."""
    monkeypatch.chdir(tmp_path)

    def fails() -> None:
        with environment.elsewhere():
            assert os.getcwd() == "/"
            raise KeyError

    with pytest.raises(KeyError):
        fails()
    assert os.getcwd() == str(tmp_path)
    gone = tmp_path / "gone"
    gone.mkdir()
    os.chdir(gone)
    gone.rmdir()
    with environment.elsewhere():
        pass


@dataclass(frozen=True)
class Words:
    """A record as of a report."""

    text: str
    parts: tuple[object, ...]
    kind: str = "kind"
    number: float = 1.5


def test_every_text_of_a_record_is_translated() -> None:
    """At any depth, except names of kinds; numbers stay."""
    found = language.translated(Words("a", ("b", Words("c", (), "d"), 2)), str.upper)

    assert found == Words("A", ("B", Words("C", (), "d"), 2))
    assert language.spoken("en")("a b") == "a b"
    assert language.spoken("de") is not str


@pytest.mark.parametrize(
    ("of", "good", "bad"),
    [
        ("cron", ["0 6 * * 1-5"], ["0 25 * * *", "often"]),
        ("interval_s", [5, 86400], [4.9, 86401, True]),
    ],
)
def test_settings_of_the_service(of: str, good: list[object], bad: list[object]) -> None:
    """Each value by itself; a cron line takes the place of the interval."""
    for value in good:
        assert getattr(preferences.Service(**{of: value}), of) == value
    for value in bad:
        with pytest.raises(ValidationError):
            preferences.Service(**{of: value})
    assert preferences.Service(interval_s=30).every_s == 30
    assert preferences.Service(interval_s=30, cron="0 6 * * *").every_s is None


@pytest.mark.parametrize(
    ("address", "good"),
    [
        ("https://a.b/c?d", True),
        ("http://localhost:1", True),
        ("http://a:65535/~", True),
        ("http://a:0", False),
        ("http://a:65536", False),
        ("http://:80", False),
        ("ftp://a.b", False),
        ("http://a b", False),
        ("http://ä.b", False),
        ("http://[a", False),
    ],
)
def test_an_address_of_a_chat_names_a_host(address: str, good: bool) -> None:
    """Blanks, umlauts, ports that are none."""
    if good:
        assert preferences.Notify(webhook=address).webhook == address
    else:
        with pytest.raises(ValidationError):
            preferences.Notify(webhook=address)


def test_preferences_come_from_the_file_and_options_override_it(tmp_path: Path) -> None:
    """Without a file, defaults; an error names its source, file and line or the option."""
    assert preferences.load(tmp_path) == preferences.Preferences()
    path = tmp_path / preferences.FILE
    path.write_text("[service]\ninterval_s = 30\nport = 5000\n[storage]\nraw = 's3://b/r'\n")

    found = preferences.load(tmp_path, {"port": 6000})
    assert (found.service.interval_s, found.service.port) == (30, 6000)
    assert found.storage.raw == "s3://b/r"
    with pytest.raises(UsageError, match=r"^--interval: 1"):
        preferences.load(tmp_path, {"interval_s": 1.0})
    path.write_text("[service]\n\nport = 1\n")
    with pytest.raises(InputError, match=r"^pipeline\.toml:3: service\.port: 1 should be"):
        preferences.load(tmp_path, {"port": 6000})
    path.write_text("[storage]\nraw = 'folder'\n")
    with pytest.raises(InputError, match="an address looks like"):
        preferences.load(tmp_path)


def test_a_certificate_has_its_own_language_or_the_projects(tmp_path: Path) -> None:
    """campaign.toml before pipeline.toml; equal looks have equal keys."""
    assert appearances(tmp_path)({}, {}) == Appearance("en")
    (tmp_path / preferences.FILE).write_text("[report]\nlanguage = 'fr'\n")
    look = appearances(tmp_path)

    assert look({}, {}) == Appearance("fr")
    assert look({"language": "de"}, {}) == Appearance("de")
    assert look({}, {}).key == Appearance("fr").key != Appearance("de").key


@pytest.mark.parametrize(
    ("kind", "good", "bad"),
    [
        (strict.Positive, [1e-12, 1e12], [0, 9e-13, 1.1e12, -1]),
        (strict.Pull, [1e-6, 1e7], [0, 9e-7, 1.1e7]),
        (strict.FileName, ["a/b.csv", "./a"], ["/a", "../a", "a/../b", ".", "", " ", "a\x1b"]),
        (strict.Glob, ["**/*.csv", "*"], ["a**/b", "**a"]),
        (strict.Prose, ["a\n\tb", ""], ["\x1b"]),
    ],
)
def test_settings_are_within_their_bounds(kind: object, good: list, bad: list) -> None:
    """The ends of each, and just beyond."""
    check = TypeAdapter(kind).validate_python
    for value in good:
        check(value)
    for value in bad:
        with pytest.raises(ValidationError):
            check(value)


def test_an_expression_has_the_parts_that_are_needed() -> None:
    """All of them; more are allowed."""
    from typing import Annotated

    check = TypeAdapter(Annotated[str, strict.with_parts("pose", "target")]).validate_python
    assert check(r"(?P<pose>\d)(?P<target>.)(?P<more>.)")
    with pytest.raises(ValidationError, match=r"\(\?P<pose>\.\.\.\), \(\?P<target>"):
        check(r"(?P<pose>\d)")
