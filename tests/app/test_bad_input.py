"""Bad input at the command line: one sentence with file, line, thing and way out; exit 5."""

import json
import os
import re

import pytest
from conftest import without_drawings

from pipeline.app import cli
from pipeline.base.errors import InputError
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import find

GOOD = simulate(Plan(name="c", poses={"count": 5})).files


def lines(change):
    """A change of the list of lines of a file."""

    def apply(content):
        return "\n".join(change(content.decode().splitlines())).encode() + b"\n"

    return apply


def without(pattern):
    """Lines that match are gone."""
    return lines(lambda rows: [row for row in rows if not re.search(pattern, row)])


def replaced(pattern, by):
    """The first match in the file is replaced."""
    return lambda content: re.sub(pattern.encode(), by.encode(), content, count=1)


def doubled(pattern):
    """The first line that matches stands there again, moved by a millimetre."""

    def twice(rows):
        row = next(row for row in rows if re.search(pattern, row)).split(",")
        row[2] = str(float(row[2]) + 1.0)
        return [*rows, ",".join(row)]

    return lines(twice)


def scaled(factor):
    """Coordinates by a factor."""

    def scale(rows):
        out = [rows[0]]
        for row in rows[1:]:
            cells = row.split(",")
            cells[2:5] = [repr(float(cell) * factor) for cell in cells[2:5]]
            out.append(",".join(cells))
        return out

    return lines(scale)


def first_cell(name, value):
    """The first value of a column."""

    def change(rows):
        cells = rows[1].split(",")
        cells[rows[0].split(",").index(name)] = value
        return [rows[0], ",".join(cells), *rows[2:]]

    return lines(change)


P2 = r"^pose03_rep2_loaded,P2,"
NUMBER = r"(pose02_rep1_loaded,P1,)[-0-9.]+"

CASES = {
    "missing file": ("joints.csv", None, ["joints.csv", "missing"]),
    "missing tracker": ("tracker.csv", None, ["campaign.toml", "tracker"]),
    "unknown robot": ("campaign.toml", replaced("kr500_rail", "kr9000"), ["kr9000", "kr500_rail"]),
    "pose without load": ("loads.csv", without("^4,"), ["loads.csv", "4"]),
    "load without pose": ("tracker.csv", without("^pose05_rep1_loaded"), ["loads.csv", "5"]),
    "duplicate reading": ("tracker.csv", doubled(P2), ["tracker.csv:", "same target"]),
    "NaN": ("tracker.csv", replaced(NUMBER, r"\1nan"), ["tracker.csv", "nan"]),
    "comma": ("tracker.csv", replaced(NUMBER, r"\g<1>1234,5678"), ["tracker.csv:"]),
    "empty file": ("tracker.csv", lambda content: b"", ["tracker.csv", "empty"]),
    "empty loads": ("loads.csv", lambda content: b"", ["loads.csv", "empty"]),
    "metres as mm": ("tracker.csv", scaled(1e-3), ["1000", "unit"]),
    "two base reflectors": ("tracker.csv", without(",B[34],"), ["base reflectors"]),
    "joint limit": ("joints.csv", first_cell("theta3_deg", "140.0"), [".csv:2", "theta3", "140"]),
    "text for a number": ("loads.csv", first_cell("force_n", "12oo"), ["loads.csv:2", "12oo"]),
    "unknown word": ("campaign.toml", replaced("sigma_m", "sigma_mm"), ["toml:", "sigma_mm"]),
    "header only": ("tracker.csv", lines(lambda rows: rows[:1]), ["tracker.csv", "no reading"]),
    "all in one place": ("tracker.csv", scaled(0.0), ["tracker.csv:2", "base reflectors", "one"]),
    "second header": ("tracker.csv", lines(lambda r: [*r, "group,target,x_m,y_m,z_m,time", *r[9:]]),
                      ["another header begins here", "split"]),
    "workbook": ("tracker.csv", lambda content: b"PK\x03\x04" + content, ["Excel", "CSV"]),
    "not TOML": ("campaign.toml", replaced("=", "=="), ["campaign.toml", "TOML"]),
}  # fmt: skip

KEPT = {
    "pose without load",
    "load without pose",
    "duplicate reading",
    "NaN",
    "comma",
    "joint limit",
    "text for a number",
}
"""What costs only its own rows, or its pose: the rest is estimated and the loss is listed."""

WRITTEN = "pose without load"
"""Its report is written, too, with what was left out."""

MENDED = {"metres as mm"}
"""What only a wrong unit explains: refused as given, with the corrected result beside it."""


LIKE_ANOTHER = {"comma", "text for a number", "load without pose", "duplicate reading"}
"""Each is kept out by the same hand as another case, and takes a whole answer to see."""
ANSWERED = {"metres as mm", "NaN", "pose without load"}
"""The same, where the other case takes a whole answer, too."""


@pytest.fixture
def undrawn():
    """Pages and PDF, with blank figures."""
    with without_drawings():
        yield


@pytest.mark.sampled(8)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            n,
            marks=[pytest.mark.slow] * (n in LIKE_ANOTHER) + [pytest.mark.whole] * (n in ANSWERED),
        )
        for n in CASES
    ],
)
def test_bad_input_is_named_and_refused(name, tmp_path, capsys, request):
    """Exit 5, every word an engineer needs, no traceback; good rows are kept where that is safe."""
    request.getfixturevalue("undrawn" if name == WRITTEN else "unseen")
    file, change, words = CASES[name]
    folder = tmp_path / "data" / "raw" / "c"
    folder.mkdir(parents=True)
    for each, content in GOOD.items():
        if each != file:
            (folder / each).write_bytes(content)
        elif change is not None:
            assert change(content) != content
            (folder / each).write_bytes(change(content))

    code = cli._exit_code(["run", "c", "--engine", "local", "--json", "--root", str(tmp_path)])
    out, err = capsys.readouterr()
    answer = json.loads(out)

    assert code == 5
    for word in words:
        assert word in err
    assert "Traceback" not in err
    if name in KEPT:
        assert answer["rejected"]
        assert all(entry["value"] for entry in answer["stiffness"][1:])
    elif name in MENDED:
        assert answer["diagnosis"]["verdict"] == "bad_data"
        assert "unit_mixup" in [cause["name"] for cause in answer["diagnosis"]["causes"]]
        nominal = [entry["nominal"] for entry in answer["stiffness"][1:]]
        found = [entry["value"] for entry in answer["stiffness"][1:]]
        assert found == pytest.approx(nominal, rel=0.2)
    else:
        assert set(answer) == {"campaign", "error"}
        assert len(err.splitlines()) == 1


def test_a_pipe_for_a_file_is_refused_at_once(tmp_path):
    """Reading it would wait for ever."""
    folder = tmp_path / "data" / "raw" / "c"
    folder.mkdir(parents=True)
    for each, content in GOOD.items():
        (folder / each).write_bytes(content)
    (folder / "joints.csv").unlink()
    os.mkfifo(folder / "joints.csv")

    with pytest.raises(InputError, match=r"joints\.csv: is no file but a device or a pipe"):
        find(tmp_path, "c").read()
