"""A remark behind a motion, on the same line."""

import pytest
from test_forces import POSES, targets

from pipeline.programs.forces import stated

SRC = f"""DEF p ( )
$TOOL=TOOL_DATA[1]
$BASE=$NULLFRAME
LIN {{{POSES[0]}}}
LIN {{{POSES[1]}}} ; FORCE 0, 0, -800
LIN {{{POSES[2]}}}
LIN {{{POSES[3]}}} ; FORCE OFF
LIN {{{POSES[4]}}}
END
"""


def test_a_remark_behind_a_motion_is_for_what_follows():
    """The robot reaches the point before it touches the part, and leaves it under load."""
    files = {"p.src": SRC}
    found = stated(files, targets(files))

    assert [one.force[2] for one in found.each] == pytest.approx([0, 0, -800, -800, 0])
