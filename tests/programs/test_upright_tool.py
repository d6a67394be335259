"""Numbers of a pose whose tool points straight along z."""

import pytest

from pipeline.programs.notation import FANUC, KUKA


@pytest.mark.parametrize("notation", [KUKA, FANUC])
@pytest.mark.parametrize("upright", [90.0, -90.0])
def test_an_upright_tool_keeps_its_orientation(notation, upright):
    """The two other angles turn about one axis: whatever they are, the pose is the same."""
    frame = notation.frame([1.0, 2.0, 3.0, 30.0, upright, 20.0])
    for near in ([30.0, upright, 20.0], [31.0, upright, 25.0], [-100.0, upright, 70.0]):
        found = notation.values(frame, [1.0, 2.0, 3.0, *near])

        assert notation.frame(found) == pytest.approx(frame, abs=1e-12)
