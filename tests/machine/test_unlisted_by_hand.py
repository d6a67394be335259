"""Laws that nobody lists: which are tried for given pulls, and what each does, by hand."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pytest

from pipeline.machine.cell import Tool, load, paper_cell
from pipeline.machine.effect import HUNG, PULLED, Pulls
from pipeline.machine.effects import unlisted
from pipeline.machine.law import Law
from pipeline.machine.robot import load as robot_of

RAIL = robot_of("kr500_rail")
K = np.array([8.0e7, 3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5])
TOOL = Tool(
    load_point=np.array([0.1, 0.05, 0.4]),
    targets=np.array(["P1", "P2"], dtype=object),
    points=np.array([[0.2, 0.0, 0.1], [0.0, 0.2, 0.15]]),
)
M = 10
RNG = np.random.default_rng(12)
Q = RNG.uniform(-1.0, 1.0, (M, 7))
Q[:, 0] = np.linspace(2.0, 11.0, M)
FORCE = 1000 * RNG.normal(size=(M, 3))
SIZE = np.linalg.norm(FORCE, axis=1)
TIME = 600.0 * np.arange(M)


def pulls(**more):
    """A pull in each of ten poses, one every ten minutes; zeros a minute or two before."""
    one = Pulls.at(Q, FORCE)
    fields = {name: getattr(one, name) for name in one.__dataclass_fields__}
    of = {"time": TIME, "time_zero": TIME - 60.0 * (1 + np.arange(M) % 2)}
    return Pulls(**fields | of | more)


def here(**more):
    """The arm under these pulls."""
    return load(paper_cell(RAIL, TOOL), pulls(**more), np.zeros(7))


def law(where=3, part="spring", kind="smooth", variable="angle", **more):
    """A law of joint 3, from -2 to 6 of its variable."""
    of = {"source": where if isinstance(where, int) else 0, "order": 1.0, "low": -2.0, "high": 6.0}
    return Law(where, part, kind, variable, **of | more)


CUTS = M - 2 * 3 + 1
"""Steps between ten values, three on either side."""


def test_laws_of_an_angle_are_waves_powers_and_steps():
    """Twenty waves, three powers, each cut; play by three waves, friction where it is known."""
    every = Counter((one.part, one.kind) for one in unlisted._of_own_angle(pulls(), 3))
    assert every == {("spring", "periodic"): 20, ("spring", "smooth"): 3,
                     ("spring", "step"): CUTS, ("play", "periodic"): 3}  # fmt: skip
    known = pulls(branch=np.eye(M)[2])  # of one pull
    parts = Counter(one.part for one in unlisted._of_own_angle(known, 3))
    assert (parts["friction"], parts["play"]) == (3, 3)
    for one in unlisted._of_own_angle(pulls(), 3):
        assert (one.where, one.source, one.variable) == (3, 3, "angle")
        assert (one.low, one.high) == (Q[:, 2].min(), Q[:, 2].max())
    orders = [one.order for one in unlisted._of_own_angle(pulls(), 3) if one.part == "spring"]
    assert orders == [*range(1, 21), 1, 2, 3, *[0] * CUTS]
    cuts = [one.at for one in unlisted._of_own_angle(pulls(), 3) if one.kind == "step"]
    q = np.sort(Q[:, 2])
    np.testing.assert_allclose(cuts, [(q[k] + q[k + 1]) / 2 for k in range(2, 7)])

    both = [*unlisted._of_angles(RAIL, pulls(), 3)]
    coupled = [(one.source, one.order) for one in both if one.kind == "coupling"]
    assert coupled == [(j, k) for j in (2, 4, 5, 6, 7) for k in (1, 2, 3)]
    still = Q.copy()
    still[:, 4] = 0.3
    coupled = {one.source for one in unlisted._of_angles(RAIL, pulls(q=still), 3)}
    assert coupled == {2, 3, 4, 6, 7}
    assert not [*unlisted._of_angles(RAIL, pulls(q=still), 5)]


def test_laws_of_a_torque_have_its_knees():
    """At fractions of the largest, either way; slips where a later reading shows them."""
    tau = np.array([-200.0, 50.0, 100.0, *[0.0] * 7])
    every = [*unlisted._of_torques(pulls(), tau, 3)]
    told = Counter((one.part, one.kind, one.variable) for one in every)
    bearings = {(f"bearing_{a}", "smooth", "force"): 1 for a in "xyz"}
    assert told == bearings | {
        ("spring", "smooth", "torque"): 3, ("knee", "smooth", "torque"): 5,
        ("knees", "smooth", "torque"): 4, ("jump", "step", "torque"): 1,
        ("tips", "step", "torque"): 1,
    }  # fmt: skip
    at = {part: [one.at for one in every if one.part == part] for part in ("knee", "knees", "tips")}
    assert at["knee"] == pytest.approx([30, 60, 90, 120, 150])
    assert at["knees"] == pytest.approx([30, 60, 90, 120])
    assert at["tips"] == [60.0]
    assert {(one.low, one.high) for one in every if one.variable == "torque"} == {(-200.0, 100.0)}
    assert {(one.low, one.high) for one in every if one.variable == "force"} == {
        (SIZE.min(), SIZE.max())
    }
    parts = ("spring", "knee", "knees", "jump", "tips", "bearing_x")
    orders = {part: [one.order for one in every if one.part == part] for part in parts}
    assert orders == {
        "spring": [1, 2, 3], "knee": [1] * 5, "knees": [2] * 4, "jump": [0], "tips": [0],
        "bearing_x": [1],
    }  # fmt: skip
    assert {(one.source, one.variable) for one in every} == {(3, "torque"), (0, "force")}
    for changed in ({"zeros_after": np.eye(M)[0]}, {"pose": np.r_[1, 1, 3 : M + 1]}):
        slips = [one for one in unlisted._of_torques(pulls(**changed), tau, 3)
                 if one.part == "slips"]  # fmt: skip
        assert [(one.order, one.at) for one in slips] == [
            (order, pytest.approx(200 * k))
            for order in (0.0, 1.0)
            for k in (0.15, 0.3, 0.45, 0.6, 0.75)
        ]
    assert not [*unlisted._of_torques(pulls(), 0 * tau, 3)]


def test_laws_of_time_position_and_force():
    """Only of what varies; waves by the length that the poses span."""
    of_time = [*unlisted._of_time(pulls(), 3, "spring")]
    assert [one.order for one in of_time] == [0.5, 1, 2, *[0] * CUTS]
    assert {(one.low, one.high, one.source) for one in of_time} == {(0.0, 5400.0, 0)}
    np.testing.assert_allclose([one.at for one in of_time[3:]], TIME[2:7] + 300)
    for constant in (np.zeros(M), np.r_[np.nan, TIME[1:]]):
        assert not [*unlisted._of_time(pulls(time=constant), 3, "spring")]
    since = [*unlisted._since_zero(pulls(), 3)]
    assert [(one.part, one.low, one.high) for one in since] == [
        (part, 60.0, 120.0) for part in ("creep", "sinks", "grows")
    ]
    assert not [*unlisted._since_zero(pulls(time_zero=TIME - 60), 3)]
    place = [*unlisted._of_position(pulls(), "rail", "roll")]
    assert [(one.kind, one.order) for one in place] == [
        *(("smooth", k) for k in (1, 2, 3)), *[("step", 0)] * CUTS,
        *(("periodic", pytest.approx(k / 9)) for k in range(1, 7)),
    ]  # fmt: skip
    assert {(one.source, one.low, one.high) for one in place} == {(1, 2.0, 11.0)}
    still = np.hstack([np.ones((M, 1)), Q[:, 1:]])
    assert not [*unlisted._of_position(pulls(q=still), "rail", "roll")]
    force = [*unlisted._of_force(pulls(), "scale", "reading")]
    assert [one.order for one in force] == [0.5, pytest.approx(2 / 3), 2, 3]
    assert {(one.low, one.high) for one in force} == {(SIZE.min(), SIZE.max())}
    jumps = [*unlisted._jumps(pulls(), "zero", 1.0)]
    each = np.sort(SIZE)
    np.testing.assert_allclose([one.at for one in jumps], (each[2:7] + each[3:8]) / 2)
    told = {(one.where, one.part, one.order, one.source) for one in jumps}
    assert told == {("scale", "zero", 1.0, 0)}
    assert {(one.where, one.source) for one in force} == {("scale", 0)}
    assert {(one.where, one.source, one.order) for one in since} == {(3, 0, 1.0)}


def test_all_laws_of_a_campaign_are_those_of_its_places():
    """Six joints with time and place, pairs, five guides, scale and tracker."""
    every = Counter((one.where, one.part) for one in unlisted._laws(RAIL, here()))
    joint = 20 + 3 + CUTS + 15 + 3 + (3 + CUTS) + (3 + CUTS + 6)
    assert every[3, "spring"] == joint
    pairs = [(one.where, one.source) for one in unlisted._laws(RAIL, here()) if one.part == "pair"]
    assert pairs == [(i, j) for i in range(2, 8) for j in range(i + 1, 8)]
    assert every["rail", "drive"] == 14 + 8
    for guide in ("lateral", "vertical", "roll", "pitch"):
        assert every["rail", guide] == 14 + 8 + 4
    assert every["scale", "reading"] == 8 + 4 + CUTS + 2
    assert every["scale", "zero"] == 8 + CUTS
    assert every["tracker", "place"] == 2
    orders = [one.order for one in unlisted._laws(RAIL, here()) if one.where == "tracker"]
    assert orders == [0.5, 2.0]
    lost = here(time_zero=np.full(M, np.nan))
    assert not any(one.where == "tracker" for one in unlisted._laws(RAIL, lost))
    directions = [one for one in unlisted._laws(RAIL, here()) if one.variable == "direction"]
    assert [one.order for one in directions] == [1.0, 2.0]
    assert {(one.low, one.high) for one in directions} == {(-1.0, 1.0)}


@pytest.mark.parametrize(
    ("count", "most", "cuts"), [(10, 12, 5), (5, 12, 0), (6, 12, 1), (40, 12, 12)]
)
def test_steps_lie_between_values_with_three_on_either_side(count, most, cuts):
    """Evenly spread if they are many; none between equal ones."""
    each = np.arange(float(count))
    found = unlisted._between(each, most)
    assert len(found) == cuts
    if cuts:
        assert found[0] == 2.5
        assert found[-1] == count - 3.5
    assert set(found) <= {k + 0.5 for k in range(count)}
    assert unlisted._between(np.repeat([1.0, 2.0], 5)) == [1.5]
    assert unlisted._between(np.r_[0, 0, 0, 0, 4.0, 5, 6, 7]) == [2.0, 4.5]


SIZES = [
    (law(), 1, "rad/(N m)", 0.15 / K[2]),
    (law(order=3.0), 3, "rad/(N m)", 0.15 / K[2]),
    (law(kind="periodic"), 2, "rad/(N m)", 0.15 / K[2]),
    (law(kind="coupling", source=5), 2, "rad/(N m)", 0.15 / K[2]),
    (law(kind="step", order=0.0), 1, "rad/(N m)", 0.15 / K[2]),
    (law(kind="periodic", more=law(kind="step", order=0.0)), 3, "rad/(N m)", 0.15 / K[2]),
    (law("rail", "drive", variable="position", source=1), 1, "m/N", 0.15 / K[0]),
    (law("rail", "roll", variable="position", source=1), 2, "rad/(N m)", 1e-8),
    (law("rail", "pitch", variable="position", source=1, order=2.0), 3, "rad/(N m)", 1e-8),
    (law("rail", "lateral", "periodic", "position", source=1), 3, "m/N", 5e-9),
    (law("rail", "vertical", "step", "position", source=1), 1, "m/N", 5e-9),
    (law("rail", "vertical", variable="force"), 1, "m/N", 5e-9),
    (law("rail", "lateral", variable="time"), 2, "m/N", 5e-9),
    (law(variable="torque", order=2.0), 1, "rad/(N m)", 0.15 / K[2]),
    (law(part="knee", variable="torque", at=1.0), 1, "rad/(N m)", 0.3 / K[2]),
    (law(part="knees", variable="torque", at=1.0), 2, "rad/(N m)", 0.3 / K[2]),
    (law(part="play", kind="periodic"), 3, "rad", 5e-5),
    (law(part="jump", kind="step", variable="torque"), 1, "rad", 5e-5),
    (law(part="creep", variable="time"), 1, "rad/(N m)/h", 2 / K[2]),
    (law(part="sinks", variable="time"), 1, "rad/h", 2e-4),
    (law(part="grows", variable="time"), 3, "m/h", 1e-4),
    (law(part="slips", kind="step", variable="torque", order=0.0), 1, "rad", 5e-5),
    (law(part="slips", kind="step", variable="torque"), 1, "rad/(N m)", 0.3 / K[2]),
    (law(part="tips", kind="step", variable="torque", at=60.0), 2, "rad", 5e-5),
    (law(part="bearing_y", variable="force"), 1, "m/N", 5e-9),
    (law(part="pair", kind="coupling", variable="torque", source=5), 1, "rad/(N m)",
     0.15 / np.sqrt(K[2] * K[4])),
    (law("scale", "reading", variable="force"), 1, "1", 0.01),
    (law("scale", "zero", variable="time"), 1, "N", 20.0),
    (law("scale", "reading", variable="direction"), 3, "1", 0.01),
    (law("tracker", "place", variable="time"), 3, "m", 5e-5),
]  # fmt: skip


@pytest.mark.parametrize(("one", "count", "unit", "typical"), SIZES)
def test_a_law_has_as_many_amplitudes_as_its_shapes(one, count, unit, typical):
    """Of a size that is usual there, either way, and as large as the data say."""
    made = unlisted.effect(RAIL, one)
    assert len(made.parameters) == count
    for p in made.parameters:
        assert (p.unit, p.typical) == (unit, pytest.approx(typical))
        assert (p.lower, p.upper) == (-np.inf, np.inf)
    assert made.tolerance == 0.1
    if hasattr(made, "carrier"):
        at = here()
        assert made.screws(at).shape[1] == len(made.carrier)
        tau = np.ones((M, len(made.carrier)))
        assert made.response(at, tau).shape == tau.shape
        joint = 1 if one.where == "rail" else 3
        assert set(made.carrier) == ({3, 5} if one.part == "pair" else {joint})


def test_shapes_are_functions_of_their_variable():
    """Waves per turn or per metre, powers of -1 to 1, powers of a share, steps either way."""
    v = np.array([-3.0, -2.0, 1.0, 4.0, 6.0, 8.0])
    u = np.array([-1.0, -1.0, -0.25, 0.5, 1.0, 1.0])
    turn = unlisted._shape(law(kind="periodic", order=3.0), v)
    np.testing.assert_allclose(turn, np.stack([np.cos(3 * v), np.sin(3 * v)], axis=1))
    metre = unlisted._shape(law("rail", "roll", "periodic", "position", order=0.25), v)
    phase = np.pi * v / 2
    np.testing.assert_allclose(metre, np.stack([np.cos(phase), np.sin(phase)], axis=1))
    smooth = unlisted._shape(law(order=3.0), v)
    np.testing.assert_allclose(smooth, np.stack([u, u**2, u**3], axis=1))
    share = np.array([0, 0, 1 / 6, 4 / 6, 1, 1])
    time = unlisted._shape(law(variable="time", order=0.5), v)
    np.testing.assert_allclose(time[:, 0], np.sqrt(share))
    force = unlisted._shape(law(variable="force", order=2.0), v)
    np.testing.assert_allclose(force[:, 0], share**2)
    above = unlisted._shape(law(kind="step", order=0.0, at=1.0), v)[:, 0]
    below = unlisted._shape(law(kind="step", order=1.0, at=1.0), v)[:, 0]
    assert above.tolist() == [0, 0, 0, 1, 1, 1]
    assert below.tolist() == [1, 1, 1, 0, 0, 0]
    single = unlisted._shape(law(low=2.0, high=2.0), np.array([2.0, 3.0]))
    np.testing.assert_allclose(single[:, 0], [0.0, 1.0])


def test_a_slope_that_changes_with_the_torque():
    """Softer one way, or by a power of the largest torque; knees beyond which it gives way."""
    tau = np.array([[-4.0], [3.0]])
    at = here()
    one = law(variable="torque", low=-8.0)
    np.testing.assert_allclose(unlisted._of_own_torque(one, tau[:, 0]), [4.0, 3.0])
    cubic = replace(one, order=3.0)
    np.testing.assert_allclose(unlisted._of_own_torque(cubic, tau[:, 0]), [-1.0, 27 / 64])
    both = unlisted.effect(RAIL, replace(one, more=cubic))
    np.testing.assert_allclose(
        both.response(at, np.hstack([tau, tau])), [[4.0, -1.0], [3.0, 27 / 64]]
    )
    knees = unlisted.effect(RAIL, law(part="knees", variable="torque", low=-8.0, at=2.0))
    np.testing.assert_allclose(
        knees.response(at, np.array([[-7.0, -7.0], [3.0, 3.0]])), [[-5.0, -2.0], [1.0, 0.0]]
    )


def test_friction_and_play_turn_with_the_torque():
    """Within 3 % of the rated torque; waves beside their constant part."""
    width = 0.03 * 6600.0
    tau = np.full((M, 3), 100.0)
    at = here(branch=np.where(np.arange(M) % 2, -1.0, 1.0))
    sense = np.tanh(100.0 / width)
    waves = np.stack([np.ones(M), np.cos(2 * Q[:, 2]), np.sin(2 * Q[:, 2])], axis=1)
    play = unlisted.effect(RAIL, law(part="play", kind="periodic", order=2.0))
    np.testing.assert_allclose(play.response(at, tau), sense * waves)
    friction = unlisted.effect(RAIL, law(part="friction", kind="periodic", order=2.0))
    way = np.where(np.arange(M) % 2, 1.0, -1.0)[:, None]
    np.testing.assert_allclose(friction.response(at, tau), way * sense * waves)
    jump = unlisted.effect(RAIL, law(part="jump", kind="step", variable="torque"))
    np.testing.assert_allclose(jump.response(at, tau[:, :1]), sense)


def test_what_sinks_creeps_or_grows_goes_by_the_time_since_the_zero():
    """One or two minutes, in hours."""
    hours = (1 + np.arange(M) % 2)[:, None] / 60
    tau = np.arange(1.0, M + 1)[:, None]
    creep, sinks, grows = (
        unlisted.effect(RAIL, law(part=part, variable="time"))
        for part in ("creep", "sinks", "grows")
    )
    np.testing.assert_allclose(creep.response(here(), tau), hours * tau)
    np.testing.assert_allclose(sinks.response(here(), tau), hours)
    np.testing.assert_allclose(grows.response(here(), tau), np.repeat(hours, 3, axis=1))
    axes = here().configuration.frame(3)[0]
    np.testing.assert_allclose(grows.screws(here())[:, :, 3:], np.swapaxes(axes, 1, 2))


def test_a_guide_has_its_constant_compliance_beside_its_law():
    """Of a step it has none of its own; of the force it is a power."""
    load_ = np.arange(1.0, M + 1)[:, None] * (-1.0) ** np.arange(M)[:, None]
    s = Q[:, 0]
    u = ((s - 6.5) / 4.5)[:, None]
    smooth = unlisted.effect(
        RAIL, law("rail", "roll", variable="position", source=1, low=2.0, high=11.0)
    )
    found = smooth.response(here(), np.repeat(load_, 2, axis=1))
    np.testing.assert_allclose(found, load_ * np.hstack([np.ones_like(u), u]), atol=1e-12)
    step = unlisted.effect(
        RAIL, law("rail", "roll", "step", "position", source=1, order=0.0, at=6.5)
    )
    np.testing.assert_allclose(step.response(here(), load_), load_ * (s > 6.5)[:, None])
    power = unlisted.effect(RAIL, law("rail", "roll", variable="force", order=0.5))
    large = unlisted.LARGE["rad/(N m)"]
    expected = np.sign(load_) * np.sqrt(np.abs(load_) * large)
    np.testing.assert_allclose(power.response(here(), load_), expected)


def test_what_a_law_depends_on_is_read_off_the_pulls():
    """Angle, place, torque, clock, time since the zero, force."""
    at = here()
    for one, expected in (
        (law(source=5), Q[:, 4]),
        (law("rail", "roll", variable="position", source=1), Q[:, 0]),
        (law(variable="time"), TIME),
        (law(part="creep", variable="time"), 60.0 * (1 + np.arange(M) % 2)),
        (law("scale", "reading", variable="force"), SIZE),
    ):
        np.testing.assert_allclose(unlisted.variable(one, at), expected)
    from pipeline.machine.robot.configuration import torque

    tau = torque(at.configuration.twists, at.load_point, at.force)
    np.testing.assert_allclose(unlisted.variable(law(variable="torque", source=6), at), tau[:, 5])


def test_the_height_of_a_law_is_half_of_what_it_varies_by():
    """Over the range of the data; for no function of a variable the size of its parameters."""
    ripple = law(kind="periodic", order=2.0, low=0.0, high=3.0)
    b, C = np.array([3e-7, -4e-7]), np.diag([1e-16, 4e-16])
    size, std = unlisted.height(ripple, b, C)
    assert size == pytest.approx(5e-7, rel=1e-5)
    assert std == pytest.approx(np.sqrt(0.6**2 * 1e-16 + 0.8**2 * 4e-16), rel=1e-3)
    guide = law("rail", "roll", variable="position", source=1)
    size, std = unlisted.height(guide, np.array([7.0, -3.0]), np.diag([9.0, 0.25]))
    assert (size, std) == pytest.approx((3.0, 0.5))
    bearing = law(part="bearing_x", variable="force")
    size, std = unlisted.height(bearing, np.array([-3.0, 4.0]), np.diag([1.0, 4.0]))
    assert (size, std) == pytest.approx((5.0, np.sqrt(0.36 + 0.64 * 4)))


@pytest.mark.parametrize(
    ("one", "follows"),
    [
        (law(), True), (law(kind="step"), True), (law(variable="torque"), False),
        (law("scale", "reading", variable="direction"), False),
        (law("scale", "reading", variable="force"), True),
        (law("rail", "roll", variable="force"), False), (law(part="knee"), False),
        (law("tracker", "place", variable="time"), False), (law(variable="time"), True),
    ],
)  # fmt: skip
def test_laws_that_multiply_by_a_function(one, follows):
    """Of anything but torque and direction; of the force only what the scale reads."""
    assert unlisted.follows(one) == follows


def test_outside_the_range_of_the_data_nobody_knows_a_law():
    """Full at once, but for a step of the grid; within, nothing."""
    v = np.array([-2.1, -2.0, -2.0 - 0.004, 0.0, 6.0, 6.004, 9.0])
    np.testing.assert_allclose(
        unlisted.outside(v, -2.0, 6.0), [1, 0, 0.004 * 1001 / 8, 0, 0, 0.004 * 1001 / 8, 1]
    )
    alone = unlisted.outside(np.array([5.0, 5.0 + 5e-6, 5.1]), 5.0, 5.0)
    np.testing.assert_allclose(alone, [0.0, 5e-6 * 1001 * 1001 / 10, 1.0], rtol=1e-6)
    ripple = law(kind="periodic", order=2.0, low=-0.5, high=0.5)
    b = np.array([3e-7, -4e-7])
    made, cov = unlisted.beyond(RAIL, unlisted.effect(RAIL, ripple), b)
    size = unlisted.height(ripple, b, np.zeros((2, 2)))[0]
    np.testing.assert_allclose(cov, [[size**2]])
    assert [p.name for p in made.parameters] == ["beyond_b_3_0"]
    tau = np.full((M, 1), 7.0)
    far = np.abs(Q[:, 2]) > 0.51
    np.testing.assert_allclose(made.response(here(), tau)[far], 7.0)
    within = np.abs(Q[:, 2]) < 0.5
    assert not made.response(here(), tau)[within].any()
    own = law(variable="torque", low=-1.0, high=1.0)
    _, cov = unlisted.beyond(RAIL, unlisted.effect(RAIL, own), np.array([2.0]))
    np.testing.assert_allclose(cov, [[4.0]])


def test_a_scale_that_changes_is_right_at_the_middle_of_its_range():
    """A factor by its law less its middle; newtons along the force; weights are what they are."""
    force = law("scale", "reading", variable="force", order=2.0, low=0.0, high=2000.0)
    made = unlisted.effect(RAIL, force)
    by = np.where(np.arange(M) % 3, PULLED, HUNG)
    at = here(by=by)
    g = np.minimum(SIZE / 2000, 1) ** 2 - 0.5
    found = made.wrench(at, np.array([0.03]))[1]
    np.testing.assert_allclose(found, FORCE * (1 + 0.03 * g * (by == PULLED))[:, None])
    zero = unlisted.effect(
        RAIL, law("scale", "zero", "step", "force", order=0.0, at=1500.0, low=0.0, high=2000.0)
    )
    found = zero.wrench(at, np.array([11.0]))[1]
    more = 11.0 * (SIZE > 1500) * (by == PULLED)
    np.testing.assert_allclose(found, FORCE * (1 + more / SIZE)[:, None])
    way = unlisted.effect(RAIL, law("scale", "reading", variable="direction", low=-1.0, high=1.0))
    b = np.array([0.01, -0.02, 0.03])
    found = way.wrench(at, b)[1]
    g = (FORCE / SIZE[:, None]) @ b
    np.testing.assert_allclose(found, FORCE * (1 + g * (by == PULLED))[:, None])
    half = np.sqrt(3.0)
    assert made.gain_std(np.array([0.03])) == pytest.approx(0.015 / half)
    assert made.zero_std(np.array([0.03])) == 0.0
    assert zero.gain_std(np.array([11.0])) == 0.0
    assert zero.zero_std(np.array([11.0])) == pytest.approx(11.0 / half)


def test_a_tracker_drifts_with_a_power_of_the_time():
    """Along each axis of F_b; before the first reading it has not."""
    made = unlisted.effect(RAIL, law("tracker", "place", variable="time", order=2.0, high=4000.0))
    points = np.zeros((3, 2, 3))
    b = np.array([1e-4, -2e-4, 3e-4])
    found = made.observe(None, points, np.array([1000.0, np.nan, -5.0]), b)
    np.testing.assert_allclose(found[0], np.tile(b / 16, (2, 1)))
    assert not found[1:].any()


@pytest.mark.parametrize(
    ("one", "other", "harmonic", "adds"),
    [
        (law(kind="periodic", order=2.0), law(kind="periodic", order=4.0), True, True),
        (law(kind="periodic", order=2.0), law(kind="periodic", order=3.0), False, True),
        (law(kind="periodic", order=2.0), law(kind="periodic", order=2.0), False, False),
        (law(kind="periodic", order=4.0), law(kind="periodic", order=2.0), False, True),
        (law(kind="coupling", order=1.0), law(kind="coupling", order=3.0), True, True),
        (law(kind="periodic", order=1.0), law(order=2.0), False, True),
        (law(order=2.0), law(order=3.0), False, False),
        (law(variable="time", order=2.0), law(variable="time", order=0.5), False, True),
        (law(kind="step", at=1.0), law(kind="step", at=2.0), False, True),
        (law(kind="step", at=1.0), law(kind="step", at=1.0), False, False),
    ],
)
def test_a_law_is_extended_by_what_it_lacks(one, other, harmonic, adds):
    """A harmonic has a whole multiple of its periods; polynomials hold those of lower degree."""
    assert unlisted._harmonic(one, other) == harmonic
    assert unlisted._adds(one, other) == adds


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (law(kind="periodic", order=3.0), "stiffness that varies 3 times per turn"),
        (law(kind="coupling", source=5, order=2.0),
         "stiffness that follows the angle of joint 5 (A4), 2 per turn"),
        (law(kind="step", at=np.deg2rad(35.4)), "stiffness that jumps at 35° of the joint"),
        (law(kind="step", variable="time", at=5400.0),
         "stiffness that jumps at 1.5 h of the campaign"),
        (law("rail", "roll", "step", "position", source=1, at=6.54),
         "roll of the carriage that jumps at 6.5 m of the rail"),
        (law("scale", "zero", "step", "force", at=1234.0), "zero that jumps at 1200 N"),
        (law("rail", "drive", "periodic", "position", source=1, order=0.333),
         "stiffness of the drive that varies 0.33 times per metre of the rail"),
        (law(), "stiffness that varies smoothly with the angle"),
        (law(part="bearing_z", variable="force"), "compliance of the bearing along its z axis"),
        (law(part="pair", kind="coupling", variable="torque", source=5),
         "compliance shared with joint 5 (A4)"),
        (law(kind="periodic", order=3.0, more=law(kind="step", at=0.5)),
         "stiffness that varies 3 times per turn and jumps at 29° of the joint"),
    ],
)  # fmt: skip
def test_a_law_is_told_in_words(one, said):
    """Its thing, what it does, and in the units of a reader."""
    made = unlisted.effect(RAIL, one)
    assert made.noun == made.signature == said
    assert made.axis == ("A2" if one.where == 3 else None)
    assert unlisted._or(["a"]) == "a"
    assert unlisted._or(["a", "b", "c"]) == "a, b or c"


def test_what_slipped_stays_until_the_next_pose():
    """Sums of what slipped so far, less what the zeros read since already have."""
    slip = np.array([1.0, 2.0, 4.0, 8.0])
    of = Some(
        pose=np.array([1, 1, 2, 2]), repeat=np.array([1, 2, 1, 2]), time=np.full(4, np.nan),
        zeros_after=np.array([0.5, 0.0, 1.0, 0.25]),
    )  # fmt: skip
    np.testing.assert_allclose(unlisted._stays(of, slip), [1 - 0.5, 3 - 0.5, 4 - 4 - 2, 12 - 4 - 2])
    back = [3, 0, 2, 1]
    turned = Some(**{name: value[back] for name, value in vars(of).items()})
    np.testing.assert_allclose(unlisted._stays(turned, slip[back]), np.array([6, 0.5, -2, 2.5]))
    late = Some(**vars(of) | {"time": np.array([20.0, 10.0, 30.0, 40.0])})
    np.testing.assert_allclose(unlisted._stays(late, slip)[:2], [3 - 0.5, 2 - 0.5])
    for order, expected in ((0.0, [0.0, -1.0]), (1.0, [0.0, -20.0])):
        one = law(part="slips", kind="step", variable="torque", order=order, at=100.0)
        made = unlisted.effect(RAIL, one)
        at = Some(pulls=Some(pose=np.array([1, 2]), repeat=np.ones(2), time=np.zeros(2),
                             zeros_after=np.zeros(2)))  # fmt: skip
        found = made.response(at, np.array([[90.0], [-120.0]]))
        np.testing.assert_allclose(found[:, 0], expected)
