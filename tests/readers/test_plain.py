"""Our own CSV is read without the dialects, with the same result; they explain errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline import readers
from pipeline.base import doors
from pipeline.base.errors import UsageError
from pipeline.dialects import _log_form, _log_rows, titled
from pipeline.machine.robot import load
from pipeline.readers import ExportSettings, logs, plain, text
from pipeline.readers._log_table import opened, typed
from pipeline.readers.export_settings import OWN_LOG
from pipeline.readers.logs import POSE

DEMO = Path(__file__).parents[2] / "data/raw/kr500_demo/tracker.csv"
KR500 = load("kr500_rail")
HEAD = "group,target,x_mm,y_mm,z_mm,time\n"
ROW = "base_start,B1,-2361.7959,10077.3516,-963.7741,2026-11-03T08:00:08\n"


@pytest.fixture
def alone(monkeypatch):
    """An installation without the dialects."""

    def imported(module):
        raise ModuleNotFoundError(module)

    monkeypatch.setattr(doors, "is_there", lambda door: False)
    monkeypatch.setattr(doors, "import_module", imported)


def test_it_reads_what_the_dialects_read():
    """To the last bit, in every field, of a file that ships."""
    own, theirs = (
        read(text(DEMO.name, DEMO.read_bytes()), ExportSettings())
        for read in (plain.read, titled.read)
    )

    assert len(own.line) > 100
    np.testing.assert_array_equal(own.position, theirs.position)
    np.testing.assert_array_equal(own.line, theirs.line)
    np.testing.assert_array_equal(own.order, theirs.order)
    for column in ("group", "target", "time", "meaning", "dialect", "encoding", "rows", "unused"):
        assert getattr(own, column) == getattr(theirs, column), column


def test_it_needs_no_dialect(alone):
    """Inches, no times and unknown names: positions in m."""
    data = b"group,target,x_in,y_in,z_in\nA,B1,1,2,-10\nA,B2,0,100,3\n"

    found = plain.read(text("t.csv", data), ExportSettings(names="(?P<group>.)(?P<target>.)"))

    np.testing.assert_allclose(found.position, 0.0254 * np.array([[1, 2, -10], [0, 100, 3]]))
    assert found.target.to_pylist() == ["B1", "B2"]
    assert found.time.null_count == 2


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ("Group;Target;X [mm];Y [mm];Z [mm]\nA;B1;1;2;3\n", {}),
        (HEAD + ROW, {"coordinates": "cartesian"}),
        (HEAD + ROW + "base_start,B2,1,x,3,\n", {}),
        (HEAD + ROW + "base_start,B2,1,,3,\n", {}),
        (HEAD + ROW + "base_start,B2,1,2,3,2026-11-33T08:00:08\n", {}),
        (HEAD + ROW + "base_start,B2,1,2,3\n", {}),
    ],
)
def test_what_is_not_ours_is_for_the_dialects(alone, data, said):
    """Other titles, hints about them, a row that is none: refused without the dialects."""
    with pytest.raises(UsageError, match=r"without pipeline\.dialects"):
        plain.read(text("t.csv", data.encode()), ExportSettings(**said))


def test_a_statistic_below_the_points_is_left_out(alone):
    """With its line; a reading without a time stays."""
    data = HEAD + ROW + "base_start,B2,1,2,3,\n" + "base_start,mean,1,2,3,\n"

    found = plain.read(text("t.csv", data.encode()), ExportSettings())

    assert found.line.tolist() == [2, 3]
    assert [line for line, _ in found.rejected] == [4]


LOGS = {"loads": ("pose", logs.of_loads()), "joints": ("pose", [POSE, *logs.own_joints(KR500)])}


@pytest.mark.parametrize("name", LOGS)
def test_a_plain_log_is_read_as_the_dialects_read_it(name, alone):
    """To the last bit, in every field, of files that ship."""
    key, wanted = LOGS[name]
    data = DEMO.with_name(f"{name}.csv").read_bytes()
    wanted = [replace(one, needed=one.stem in ("pose", "force")) for one in wanted]
    own = typed(opened(name, data, OWN_LOG, name, key), wanted, OWN_LOG, name)
    theirs = _log_rows.typed(
        _log_form.opened(name, data, OWN_LOG, name, key), wanted, OWN_LOG, name
    )

    assert len(own.line) > 10
    assert [*own.number] == [*theirs.number]
    assert [*own.word] == [*theirs.word]
    for column in (*own.number, *own.word):
        mine, other = ((one.number | one.word)[column] for one in (own, theirs))
        np.testing.assert_array_equal(mine, other)
    np.testing.assert_array_equal(own.line, theirs.line)
    assert (own.rejected, own.notes, own.pose_of) == (theirs.rejected, theirs.notes, theirs.pose_of)


@pytest.mark.parametrize(
    "data",
    [
        "pose,force_n\n1,700 N\n",
        "pose,force_n\nP1,700.5\n",
        "pose,force_n\n1,700.5\n,800.5\n",
        "pose,force_n\n1,700.5\n2\n",
        "pose,force_n\n1,700.5\n\n2,800.5\n",
        "pose;force_n\n1;700.5\n",
        "pose,force_n\n1,700.5",
        "pose,force_n\n-,kN\n1,0.7\n",
        "pose,force\n1,700.5\n",
        "pose,payload\n12,120kg\n",
        "pose,payload\n1,kg\n",
    ],
)
def test_any_other_log_is_for_the_dialects(alone, data):
    """A unit behind a number, an empty cell, a row too short, a file that may have been cut off."""
    with pytest.raises(UsageError, match=r"without pipeline\.dialects"):
        logs.loads("loads.csv", data.encode())


def test_the_dialects_say_what_a_row_is():
    """For example a repeated header, which the plain reader cannot name."""
    found = readers.read("t.csv", (HEAD + ROW + HEAD + ROW).encode())

    assert found.rejected == ((3, "the header comes again; remove the row"),)
