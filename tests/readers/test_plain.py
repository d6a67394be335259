"""Our own CSV is read without the dialects, with the same result; they explain errors."""

from pathlib import Path

import numpy as np
import pytest

from pipeline import readers
from pipeline.base import doors
from pipeline.base.errors import UsageError
from pipeline.dialects import titled
from pipeline.readers import ExportSettings, plain, text

DEMO = Path(__file__).parents[2] / "data/raw/kr500_demo/tracker.csv"
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
    ],
)
def test_what_is_not_ours_is_for_the_dialects(alone, data, said):
    """Other titles, or hints about them in campaign.toml: refused without the dialects."""
    with pytest.raises(UsageError, match=r"without pipeline\.dialects"):
        plain.read(text("t.csv", data.encode()), ExportSettings(**said))


def test_a_row_that_is_none_is_left_out(alone):
    """With its line, and also a statistic below the points."""
    data = HEAD + ROW + "base_start,B2,1,x,3,\n" + "base_start,mean,1,2,3,\n"

    found = plain.read(text("t.csv", data.encode()), ExportSettings())

    assert found.line.tolist() == [2]
    assert [line for line, _ in found.rejected] == [3, 4]


def test_the_dialects_say_what_a_row_is():
    """For example a repeated header, which the plain reader cannot name."""
    found = readers.read("t.csv", (HEAD + ROW + HEAD + ROW).encode())

    assert found.rejected == ((3, "the header comes again; remove the row"),)
