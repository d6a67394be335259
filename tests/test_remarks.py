"""What is said of stiffnesses: one factor on all of them, which no residual shows."""

import pytest
import report_sample

from pipeline.answer.remarks import common_factor

JOINTS = [joint for joint in report_sample.answer().stiffness if joint.value and joint.nominal]


def scaled(*factors):
    """The joints of a report, each so many times as stiff as in the robot file."""
    pairs = zip(JOINTS, factors, strict=False)
    return [joint.model_copy(update={"value": f * joint.nominal}) for joint, f in pairs]


@pytest.mark.parametrize(
    ("factor", "said"),
    [(9.81, "9.8"), (4.448, "4.4"), (2.0, "2.0"), (0.5, "0.50"), (0.102, "0.10")],
)
def test_a_scale_in_another_unit_is_told(factor, said):
    """Kilograms or pounds for newtons: the stiffnesses are as many times too large or small."""
    told = common_factor(scaled(0.9 * factor, factor, 1.2 * factor))

    assert told.startswith(f"The stiffnesses are about {said} times those of the robot file")


@pytest.mark.parametrize("factors", [(0.7, 1.0, 1.4), (0.8, 1.1, 5.0), (0.69, 0.7, 0.7), (9.81,)])
def test_another_specimen_is_no_other_unit(factors):
    """Robots of a type differ by tens of per cent, and one joint may be another one."""
    assert common_factor(scaled(*factors)) is None


def test_what_the_file_does_not_state_is_not_compared():
    """Nor what the campaign does not determine."""
    far = scaled(5.0, 5.0, 5.0)

    assert common_factor([one.model_copy(update={"nominal": None}) for one in far]) is None
    assert common_factor([one.model_copy(update={"identifiable": False}) for one in far]) is None
