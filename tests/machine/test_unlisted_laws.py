"""Laws outside the catalogue: what each moves, its odds, its form and its words."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from unlisted_laws import CELL, KR500, PULLS, law, turning, with_and_without

from pipeline.machine.cell import load, sensitivity
from pipeline.machine.effects import unlisted
from pipeline.machine.law import parse

Q, S, HOURS = PULLS.q, PULLS.q[:, 0], PULLS.time / 3600
SINCE = (PULLS.time - PULLS.time_zero) / 3600
CASES = {
    "ripple": (
        law(3, "spring", "periodic", "angle", 3, 7.0),
        1,
        turning(3, lambda own, _: own * np.sin(7 * Q[:, 2])),
    ),
    "ripple with its second harmonic": (
        replace(
            law(3, "spring", "periodic", "angle", 3, 7.0),
            more=law(3, "spring", "periodic", "angle", 3, 14.0),
        ),
        3,
        turning(3, lambda own, _: own * np.sin(14 * Q[:, 2])),
    ),
    "softer one way and stiffer under load": (
        replace(
            law(2, "spring", "smooth", "torque", 2, 1.0, (-2000.0, 3000.0)),
            more=law(2, "spring", "smooth", "torque", 2, 3.0, (-2000.0, 3000.0)),
        ),
        1,
        turning(2, lambda own, _: own * (own / 3000.0) ** 2),
    ),
    "roll along the rail that also jumps": (
        replace(
            law("rail", "roll", "smooth", "position", 1, 1.0),
            more=law("rail", "roll", "step", "position", 1, 0.0, at=6.0),
        ),
        2,
        turning(1, lambda own, _: own * (S > 6.0), (0, 1, 0), fixed=True),
    ),
    "by another joint": (
        law(4, "spring", "coupling", "angle", 6, 2.0),
        0,
        turning(4, lambda own, _: own * np.cos(2 * Q[:, 5])),
    ),
    "step on the rail": (
        law("rail", "roll", "step", "position", 1, 0.0, at=6.0),
        0,
        turning(1, lambda own, _: own * (S > 6.0), (0, 1, 0), fixed=True),
    ),
    "drive by the metre": (
        law("rail", "drive", "periodic", "position", 1, 0.25),
        0,
        turning(1, lambda own, _: own * np.cos(2 * np.pi * S / 4), slides=True),
    ),
    "rollers": (
        law("rail", "vertical", "smooth", "force", 0, 2 / 3),
        0,
        turning(
            1,
            lambda own, _: 10 * np.sign(own) * np.abs(own) ** (2 / 3),
            (0, 0, 1),
            slides=True,
            fixed=True,
        ),
    ),
    "warms": (
        law(5, "spring", "smooth", "time", 0, 2.0, (0.0, 2e4)),
        0,
        turning(5, lambda own, _: own * (HOURS * 3600 / 2e4) ** 2),
    ),
    "knees": (
        law(2, "knees", "smooth", "torque", 2, 2.0, (-4000.0, 3000.0), 1000.0),
        1,
        turning(2, lambda own, _: np.sign(own) * np.maximum(np.abs(own) - 2500.0, 0)),
    ),
    "creeps": (
        law(6, "creep", "smooth", "time"),
        0,
        turning(6, lambda own, _: own * SINCE),
    ),
    "grows": (
        law(3, "grows", "smooth", "time"),
        0,
        turning(3, lambda own, _: SINCE, (1, 0, 0), slides=True),
    ),
    "bearing": (
        law(4, "bearing_z", "smooth", "force"),
        0,
        turning(4, lambda own, _: own, slides=True),
    ),
    "tips": (
        law(5, "tips", "step", "torque", 5, 0.0, at=60.0),
        1,
        turning(5, lambda own, _: np.tanh(own / 60.0), (0, 1, 0)),
    ),
    "friction, less on the way up": (
        law(3, "friction", "periodic", "angle", 3, 2.0),
        0,
        turning(
            3, lambda own, _: -PULLS.branch * np.tanh(own / (3e-5 * KR500.joints[2].stiffness))
        ),
    ),
    "pair": (
        law(3, "pair", "coupling", "torque", 5),
        0,
        [
            *turning(3, lambda _, every: every["j5"]),
            *turning(5, lambda _, every: every["j3"]),
        ],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_law_moves_the_reflectors_as_a_machine_that_has_it(name):
    """Columns equal the effect of springs of another machine (4 x 4 matrices) per amplitude."""
    one, column, springs = CASES[name]
    eps = 1e-9
    machine, bare = with_and_without(springs, eps)
    tool = CELL.tool
    moved, still = (
        m.settle(Q, tool.points, tool.load_point, PULLS.force)[0] for m in (machine, bare)
    )

    made = sensitivity(CELL, PULLS, np.zeros(7), [unlisted.effect(KR500, one)])[..., column]

    assert np.abs(made).max() > 0
    np.testing.assert_allclose(
        (moved - still) / eps, made, atol=2e-3 * np.abs(made).max() + 1e-3 * np.abs(made).mean()
    )


@pytest.mark.parametrize(
    ("variable", "most", "of"),
    [
        ("time", 2e4, lambda: PULLS.time),
        ("force", 4e3, lambda: np.linalg.norm(PULLS.force, axis=1)),
    ],
)
def test_the_scale_reads_another_force_by_the_law(variable, most, of):
    """The relative force error scales the displacements; it is none in the middle of the range."""
    x = KR500.nominal_compliance
    one = unlisted.effect(KR500, law("scale", "reading", "smooth", variable, 0, 1.0, (0.0, most)))
    moved = sensitivity(CELL, PULLS, x, CELL.effects) @ x

    made = sensitivity(CELL, PULLS, x, [one])[..., 0]

    share = (of() / most - 0.5)[:, None, None]
    np.testing.assert_allclose(made, moved * share, rtol=1e-6, atol=1e-6 * np.abs(moved).max())


@pytest.mark.parametrize(
    ("part", "variable", "kind", "gain", "zero"),
    [
        ("reading", "time", "smooth", 0.03 / np.sqrt(12), 0.0),
        ("reading", "time", "step", 0.03 / np.sqrt(12), 0.0),
        ("reading", "force", "smooth", 0.03 / np.sqrt(12), 0.0),
        ("zero", "time", "smooth", 0.0, 0.03 / np.sqrt(3)),
        ("zero", "force", "step", 0.0, 0.03 / np.sqrt(3)),
    ],
)
def test_where_a_scale_that_changes_was_right_is_not_known(part, variable, kind, gain, zero):
    """A gain that changes by 3 % in all was right at any level of that range with equal odds.

    A zero that changes by 0.03 N may be off by as much in every pull.
    """
    one = unlisted.effect(KR500, law("scale", part, kind, variable, 0, 1.0, (0.0, 2e4), at=1e4))

    assert one.gain_std(np.array([-0.03])) == pytest.approx(gain)
    assert one.zero_std(np.array([-0.03])) == pytest.approx(zero)


def test_a_gain_that_changes_with_the_direction_of_the_force_may_be_off_everywhere():
    """By as much as it changes from one direction to the opposite, at any level alike."""
    one = unlisted.effect(KR500, law("scale", "reading", "smooth", "direction", 0, 1.0, (-1, 1)))

    assert one.gain_std(np.array([0.0, 0.03, 0.04])) == pytest.approx(0.05 / np.sqrt(3))


def test_a_scale_may_read_steep_chains_otherwise_up_and_down_alike():
    """F (1 - u_z^2) is a gain and the law of second order: the five and that gain are complete."""
    x, u = KR500.nominal_compliance, PULLS.force / np.linalg.norm(PULLS.force, axis=1)[:, None]
    one = unlisted.effect(KR500, law("scale", "reading", "smooth", "direction", 0, 2.0, (-1, 1)))
    whole = sensitivity(CELL, PULLS, x, CELL.effects) @ x
    made = sensitivity(CELL, PULLS, x, [one]).reshape(-1, 5)

    wanted = (whole * (u[:, 2] ** 2)[:, None, None]).ravel()
    both = np.column_stack([whole.ravel(), made])
    left = wanted - both @ np.linalg.lstsq(both, wanted, rcond=None)[0]
    assert np.linalg.norm(left) < 1e-6 * np.linalg.norm(wanted)


@pytest.mark.parametrize(("order", "count"), [(1.0, 3), (2.0, 5)])
def test_the_size_of_a_law_of_the_direction_is_the_same_in_any_frame(order, count):
    """Harmonics have alike means of products over the corners of an icosahedron, as over a sphere.

    Planted bug: x^2 - y^2 had half the size of the same law turned by 45 degrees, 2 x y.
    """
    golden, ends = (1 + np.sqrt(5)) / 2, np.array([[0, s, t] for s in (1, -1) for t in (1, -1)])
    corners = np.concatenate([np.roll(ends * [0, 1, golden], k, axis=1) for k in range(3)])
    one = law("scale", "reading", "smooth", "direction", 0, order, (-1, 1))

    g = unlisted._aslant(one, SimpleNamespace(force=1500.0 * corners))

    assert g.T @ g / len(g) == pytest.approx(np.eye(count) / 3)


def test_a_zero_of_the_scale_that_jumps_adds_the_same_force_to_every_later_pull():
    """One newton along the chain adds displacement over force, whatever the pull."""
    x, at = KR500.nominal_compliance, float(np.median(PULLS.time))
    where = law("scale", "zero", "step", "time", 0, 0.0, (0.0, 2e4), at)
    one = unlisted.effect(KR500, where)
    per_newton = sensitivity(CELL, PULLS, x, CELL.effects) @ x
    per_newton = per_newton / np.linalg.norm(PULLS.force, axis=1)[:, None, None]

    made = sensitivity(CELL, PULLS, x, [one])[..., 0]

    newtons = np.sum(made * per_newton, axis=(1, 2)) / np.sum(per_newton**2, axis=(1, 2))
    np.testing.assert_allclose(made, newtons[:, None, None] * per_newton, atol=1e-15)
    before, after = newtons[PULLS.time < at], newtons[PULLS.time > at]
    assert np.ptp(before) == pytest.approx(0, abs=1e-9)
    assert after - before.mean() == pytest.approx(1)
    assert one.called.startswith("zero that jumps at ")
    assert one.parameters[0].unit == "N"


def test_a_dead_band_adds_the_same_force_to_every_small_pull():
    """Pulls up to a limit lose the same force; larger ones lose none."""
    sticks = unlisted.effect(KR500, law("scale", "zero", "step", "force", 0, 1.0, at=1500.0))
    loaded = load(CELL, PULLS, KR500.nominal_compliance)
    size = np.linalg.norm(PULLS.force, axis=1)

    point, force = sticks.wrench(loaded, np.array([-40.0]))

    lost = np.where(size <= 1500.0, 40.0, 0.0)
    assert np.linalg.norm(force, axis=1) == pytest.approx(size - lost)
    assert 0 < lost.sum() < 40.0 * len(size)
    np.testing.assert_array_equal(point, loaded.load_point)


def test_a_jump_is_sought_between_all_pulls_and_not_the_first_of_each_pose():
    """For laws of the force, steps are between any two different pulls."""
    laws = unlisted.effects(KR500, load(CELL, PULLS, KR500.nominal_compliance))
    at = [one.law.at for one in laws if one.law.of[:3] == ("scale", "zero", "force")]
    size = np.sort(np.linalg.norm(PULLS.force, axis=1))
    assert len(at) == min(len(size) - 5, 60)
    assert size[2] < min(at) < size[3]
    assert size[-4] < max(at) < size[-3]


def test_a_jump_is_never_sought_between_pulls_of_the_same_force():
    """Three load steps in all directions; equal forces may differ by a rounding, and are equal."""
    size = np.repeat([1000.0, 2000.0, 3000.0], [12, 12, 16])[:, None]
    along = PULLS.force / np.linalg.norm(PULLS.force, axis=1, keepdims=True)
    pulls = replace(PULLS, force=size * along)
    assert len(np.unique(np.linalg.norm(pulls.force, axis=1))) > 3

    laws = unlisted.effects(KR500, load(CELL, pulls, KR500.nominal_compliance))
    at = [one.law.at for one in laws if one.law.of[:3] == ("scale", "zero", "force")]

    assert at == pytest.approx([1500.0, 2500.0], abs=1e-9)


def test_every_law_has_a_share_of_the_odds_and_a_form_that_a_file_can_hold():
    """Probabilities of all laws sum to one; label and form reproduce each law."""
    every = unlisted.effects(KR500, load(CELL, PULLS, np.zeros(7)))
    forms = {(one.label, one.form) for one in every}

    assert sum(one.odds for one in every) == pytest.approx(1.0)
    assert len(forms) == len(every) > 500
    assert all(parse(str(one.law.where), one.form) == one.law for one in every)
    assert unlisted.named(KR500, "joint_tilt:3", "") is None
    assert unlisted.named(KR500, "unlisted_law:3", "spring wavy angle 3 1 0 1 0 False") is None


def test_a_law_calls_joints_as_the_controller_calls_its_axes():
    """The place, and the joint whose angle or torque it depends on; the rail moves alone."""
    every = [
        law(4, "spring", "coupling", "angle", 6, 2.0),
        law(3, "pair", "coupling", "torque", 5),
        law("rail", "roll", "step", "position", 1, 0.0, at=6.0),
    ]

    assert [unlisted.effect(KR500, one).called for one in every] == [
        "stiffness that follows the angle of joint 6 (A5), 2 per turn in joint 4 (A3)",
        "compliance shared with joint 5 (A4) in joint 3 (A2)",
        "roll of the carriage that jumps at 6.0 m of the rail at the rail",
    ]
    made = unlisted.effects(KR500, load(CELL, PULLS, np.zeros(7)))
    axes = {unlisted.worded(KR500, one).axis for one in made}
    assert axes == {None, "A1", "A2", "A3", "A4", "A5", "A6"}


def test_what_a_law_lacks_is_tried_in_its_own_place_and_variable():
    """Each further shape once, with the probability of the law, half of it for harmonics."""
    loaded = load(CELL, PULLS, np.zeros(7))
    wave = replace(unlisted.effect(KR500, law(5, "spring", "periodic", "angle", 5, 3.0)), odds=0.2)
    other = unlisted.effect(KR500, law(2, "pair", "coupling", "torque", 5))

    further = unlisted.extensions(KR500, loaded, wave)

    orders = [one.law.more.order for one in further if one.law.more.kind == "periodic"]
    harmonics = [one for one in further if one.law.more.order in (6, 9, 12, 15, 18)]
    assert sorted(orders) == [k for k in range(1, 21) if k != 3]
    assert {one.law.more.kind for one in further} == {"periodic", "smooth", "step"}
    assert {one.label for one in further} == {wave.label}
    assert all(one.law.more.of == wave.law.of and one.law.extends(wave.law) for one in further)
    assert not any(wave.law.extends(one.law) for one in further)
    assert sum(one.odds for one in further) == pytest.approx(0.2)
    assert sum(one.odds for one in harmonics) == pytest.approx(0.1)
    assert all(unlisted.named(KR500, one.label, one.form).law == one.law for one in further)
    assert unlisted.extensions(KR500, loaded, other) == ()


def test_what_is_not_decided_of_a_law_is_said():
    """Orders in one phrase, another kind as another law, and nothing twice."""
    wave = law(5, "spring", "periodic", "angle", 5, 2.0)
    six, steady = replace(wave, order=6.0), law(5, "spring", "smooth", "time")
    both = [replace(wave, order=3.0, more=one) for one in (wave, replace(wave, order=9.0))]

    def said(one, *others):
        return unlisted.undecided(KR500, unlisted.effect(KR500, one), others).noun

    assert said(wave, six) == "stiffness that varies 2 or 6 times per turn"
    assert said(both[0], both[1]) == (
        "stiffness that varies 3 times per turn and varies 2 or 9 times per turn"
    )
    assert said(wave, steady, six) == (
        "stiffness that varies 2 or 6 times per turn, or stiffness that changes with time"
    )
    assert said(steady, replace(steady, order=2.0)) == "stiffness that changes with time"
    assert said(six) == unlisted.effect(KR500, six).noun


@pytest.mark.parametrize(
    ("order", "expected"), [(1.0, [-50, -100, 50, 250, 250]), (0.0, [0, -1, 0, 1, 1])]
)
def test_what_slipped_stays_and_moves_the_zeros_read_since(order, expected):
    """Beyond 150 N m, by the excess or by one angle; half of pose 1's zeros follow its pulls."""
    slips = unlisted.effect(KR500, law(5, "slips", "step", "torque", 5, order, at=150.0))
    pulls = replace(
        PULLS.part(np.arange(5)),
        pose=np.array([1, 1, 1, 2, 2]),
        time=np.array([10.0, 20.0, 30.0, 40.0, 50.0]),
        zeros_after=np.array([0.5, 0.5, 0.5, 0.0, 0.0]),
    )
    tau = np.array([100.0, -200.0, 300.0, 400.0, 50.0])
    mixed = np.array([3, 2, 0, 4, 1])

    for rows in (np.arange(5), mixed):
        made = slips.response(SimpleNamespace(pulls=pulls.part(rows)), tau[rows, None])
        np.testing.assert_allclose(made[:, 0], np.array(expected, float)[rows])


def test_joints_may_slip_only_where_a_later_reading_shows_that_it_stays():
    """A second pull of the pose, or a zero after the first one."""
    alone = PULLS.part(np.unique(PULLS.pose, return_index=True)[1])
    after = replace(alone, zeros_after=np.full(len(alone), 0.5))
    twice = replace(alone, pose=np.arange(len(alone)) // 2)
    tau = np.linspace(-300.0, 500.0, len(alone))

    tried = [
        {one.at for one in unlisted._of_torques(pulls, tau, 4) if one.part == "slips"}
        for pulls in (alone, after, twice)
    ]

    assert tried == [set(), *[{75.0, 150.0, 225.0, 300.0, 375.0}] * 2]
