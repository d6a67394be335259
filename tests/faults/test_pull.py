"""Mistakes in all forces: the pull reversed and the unit of the scale, planted and corrected."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from pipeline.faults.pull import force_unit, reversed_pull, times
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

NEWTON = {"kn": 1000.0, "kgf": 9.80665, "lbf": 4.4482216152605}
PLAN = Plan(name="good", seed=11, poses={"count": 4}, pulls={"steps_n": [3000.0]})
FORCES = ("fx_n", "fy_n", "fz_n")


@cache
def good():
    """A campaign of four poses in which nothing is wrong."""
    return ingested(in_memory(simulate(PLAN).files), plausible=False)


def estimate(factor, relative=0.01):
    """Compliances as a multiple of the nominal ones, each with a relative uncertainty."""
    value = np.broadcast_to(factor, 7) * good().robot.nominal_compliance
    return SimpleNamespace(value=value, std=np.abs(value) * relative)


def end_for_end(case):
    """The first reflector of the chain named as the second in campaign.toml."""
    naming = case.settings.naming
    turned = naming.model_copy(update={"chain": list(naming.chain)[::-1]})
    return replace(case, settings=case.settings.model_copy(update={"naming": turned}))


def reduced(case, rng):
    """The same campaign as if it had arrived reduced, with a column in addition to the forces."""
    fields = [pa.field(name, pa.float64(), metadata={"unit": "N"}) for name in FORCES]
    schema = pa.schema([pa.field("pose", pa.int32()), *fields], metadata={"table": "forces"})
    columns = [np.arange(5, dtype=np.int32), *rng.standard_normal((3, 5))]
    return replace(case, forces=pa.table(list(map(pa.array, columns)), schema=schema))


def test_a_reversed_pull_is_named_and_turned_round():
    """All clear compliances are negative and the ends of the chain are exchanged."""
    bad = end_for_end(good())

    (found,) = reversed_pull(bad, estimate(-1.0))

    assert (found.name, found.where) == ("sign_or_convention", "pull_reversed")
    assert (found.before, found.after) == (1.0, 0.0)
    assert "7 of 7 clear compliances" in found.evidence
    assert "100% of the pulls" in found.evidence
    right = found.correct(bad)
    assert list(right.settings.naming.chain) == list(good().settings.naming.chain)
    assert right.readings is bad.readings


def test_a_chain_that_hangs_as_it_is_named_was_not_reversed():
    """Negative compliances for another reason: the first end is the nearer one in every pull."""
    assert reversed_pull(good(), estimate(-1.0)) == []


SIGNS = [
    ([-1, -1, -1, -1, -1, -1, -1], 0.01, True),
    ([1, 1, 1, 1, 1, 1, 1], 0.01, False),
    ([-1, -1, -1, -1, -1, 1, 1], 0.01, False),  # 2 of 7 squares contradict it
    ([-1, -1, -1, -1, -1, -1, -1], 0.24, True),
    ([-1, -1, -1, -1, -1, -1, -1], 0.26, False),  # none is clearly different from zero
]


@pytest.mark.parametrize(("signs", "relative", "named"), SIGNS)
def test_only_clear_signs_count(signs, relative, named):
    """Beyond four standard uncertainties, and nine tenths of their squares."""
    found = reversed_pull(end_for_end(good()), estimate(np.array(signs, float), relative))

    assert bool(found) is named


def test_one_sure_spring_does_not_speak_for_all():
    """It has nearly all the weight, but six in ten of the clear ones must be negative."""
    value = good().robot.nominal_compliance * np.array([-1.0, 1, 1, 1, 1, 1, 1])
    sure = np.abs(value) * np.array([1e-4, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2])
    bad = end_for_end(good())

    assert reversed_pull(bad, SimpleNamespace(value=value, std=sure)) == []
    most = value * np.array([1, -1, -1, -1, -1, 1, 1])
    (found,) = reversed_pull(bad, SimpleNamespace(value=most, std=sure))
    assert "5 of 7" in found.evidence
    assert found.before == pytest.approx((1e8 + 4 * 25) / (1e8 + 6 * 25))


def test_an_undetermined_spring_has_no_sign():
    """Infinite uncertainty: five others decide."""
    some = estimate(np.array([1.0, 1, -1, -1, -1, -1, -1]))
    some.std[:2] = np.inf

    (found,) = reversed_pull(end_for_end(good()), some)

    assert "5 of 5" in found.evidence


def test_forces_of_a_reduced_campaign_are_turned_round():
    """All three components, and no other column; twice restores the original."""
    case = reduced(end_for_end(good()), np.random.default_rng(1))
    (found,) = reversed_pull(case, estimate(-1.0))

    right = found.correct(case)

    for name in FORCES:
        assert right.forces[name].to_numpy() == pytest.approx(-case.forces[name].to_numpy())
    assert right.forces["pose"].equals(case.forces["pose"])
    assert right.forces.schema.equals(case.forces.schema, check_metadata=True)
    assert right.settings == case.settings
    assert found.correct(right).forces.equals(case.forces)


@pytest.mark.parametrize("unit", NEWTON)
@pytest.mark.parametrize("sense", [1, -1], ids=["read as newton", "was newton"])
def test_a_wrong_unit_of_the_scale_is_named_and_undone(unit, sense):
    """All stiffnesses are off by the factor of the unit, each by some 10 % more or less."""
    factor = NEWTON[unit] ** sense
    spread = np.exp(np.array([0.2, -0.2, 0.1, 0.0, -0.1, 0.15, -0.15]))
    bad = replace(good(), loads=good().loads.assign(force_n=good().loads["force_n"] / factor))

    (found,) = force_unit(bad, estimate(factor * spread))

    assert (found.name, found.where) == ("unit_mixup", unit if sense > 0 else "n")
    right = found.correct(bad).loads
    assert right["force_n"].to_numpy() == pytest.approx(good().loads["force_n"].to_numpy())
    assert found.before == pytest.approx(factor)
    assert found.after == pytest.approx(1.0)
    assert f"times too {'small' if sense > 0 else 'large'}" in found.evidence


APART = np.array([-1.0, 1, -1, 1, 0, 1, -1])


@pytest.mark.parametrize(
    ("factor", "spread", "named"),
    [
        (1.0, 0.0, False),
        (NEWTON["kgf"] * np.exp(0.25), 0.0, True),
        (NEWTON["kgf"] * np.exp(0.40), 0.0, False),
        (NEWTON["lbf"] * np.exp(-0.25), 0.0, True),
        (NEWTON["lbf"] * np.exp(-0.40), 0.0, False),
        (NEWTON["kgf"], 0.5, True),
        (NEWTON["kgf"], 0.7, False),
        (-NEWTON["kgf"], 0.0, False),
        (3.0, 0.0, False),
    ],
)
def test_a_machine_may_be_softer_than_its_kind(factor, spread, named):
    """All joints by a common factor below 1.5, and less if joints disagree."""
    assert bool(force_unit(good(), estimate(factor * np.exp(spread * APART)))) is named


def test_few_joints_are_less_sure_of_a_unit_than_many():
    """A quarter softer than in kilogram-force: seven consistent joints decide, three do not."""
    seven = estimate(NEWTON["kgf"] * np.exp(0.25))
    three = estimate(NEWTON["kgf"] * np.exp(0.25))
    three.std[3:] = np.inf

    assert len(force_unit(good(), seven)) == 1
    assert force_unit(good(), three) == []


def test_machines_as_delivered_tell_the_unit_and_no_other_factor():
    """Joints off by 25 %, specimens by 10 % in common: drawn, not computed."""
    rng = np.random.default_rng(7)
    joints = rng.uniform(0.75, 1.25, (200, 7))
    own = joints * np.exp(0.1 * rng.standard_normal((200, 1)))
    between = np.sqrt(NEWTON["kgf"] * NEWTON["lbf"])

    def named(drawn):
        found = [force_unit(good(), estimate(NEWTON["lbf"] * each)) for each in drawn]
        return np.mean([len(one) == 1 and one[0].where == "lbf" for one in found])

    assert named(joints) > 0.99
    assert named(own) > 0.9
    assert not any(force_unit(good(), estimate(each)) for each in own)
    assert np.mean([bool(force_unit(good(), estimate(between * each))) for each in joints]) < 0.05


def test_a_range_that_holds_two_units_tells_neither():
    """Published as one to five times the lowest value: lbf and kgf are both possible."""
    nominal = [joint.typical_stiffness for joint in good().robot.joints]
    ranged = tuple(
        joint.model_copy(
            update=NOTHING
            | {
                f"stiffness_range_{'n_per_m' if joint.prismatic else 'nm_per_rad'}": (
                    k / 2,
                    2.5 * k,
                )
            }
        )
        for joint, k in zip(good().robot.joints, nominal, strict=True)
    )
    wide = replace(good(), robot=replace(good().robot, joints=ranged))

    assert force_unit(wide, estimate(np.sqrt(NEWTON["kgf"] * NEWTON["lbf"]))) == []


NOTHING = {"stiffness_n_per_m": None, "stiffness_nm_per_rad": None}


def test_two_sure_springs_are_too_few_for_a_unit():
    """At least three known to a third are needed, on a robot with published stiffnesses."""
    three = estimate(NEWTON["kgf"])
    three.std[3:] = np.abs(three.value[3:])
    assert len(force_unit(good(), three)) == 1
    three.std[2] = np.inf
    assert force_unit(good(), three) == []

    unknown = tuple(joint.model_copy(update=NOTHING) for joint in good().robot.joints)
    bare = replace(good(), robot=replace(good().robot, joints=unknown))
    assert force_unit(bare, estimate(NEWTON["kgf"])) == []


def test_a_factor_holds_for_scale_readings_and_reduced_forces_alike():
    """And its inverse restores the original."""
    case = reduced(good(), np.random.default_rng(2))
    more = times(9.80665)(case)

    assert more.loads["force_n"].to_numpy() == pytest.approx(
        9.80665 * case.loads["force_n"].to_numpy()
    )
    for name in FORCES:
        assert more.forces[name].to_numpy() == pytest.approx(9.80665 * case.forces[name].to_numpy())
    back = times(1 / 9.80665)(more)
    assert back.forces["fy_n"].to_numpy() == pytest.approx(case.forces["fy_n"].to_numpy())
    assert times(2.0)(good()).forces is None


@pytest.mark.parametrize("unclear", [0.5, np.inf])
def test_springs_that_are_not_clear_have_no_vote(unclear):
    """Three of seven are clear and negative: six in ten of three, not of seven, are required."""
    some = estimate(np.array([-1.0, -1, -1, 1, 1, 1, 1]))
    some.std[3:] = unclear * np.abs(some.value[3:])

    (found,) = reversed_pull(end_for_end(good()), some)

    assert "3 of 3 clear compliances" in found.evidence


@pytest.mark.parametrize(("clear", "told"), [(3.1, 1), (2.9, 0)])
def test_three_springs_of_three_standard_uncertainties_tell_a_unit(clear, told):
    """Forces in kN that were read as N; one of them just below, and two are too few."""
    relative = np.where(np.arange(7) < 2, 0.01, np.where(np.arange(7) == 2, 1 / clear, 10.0))
    assert len(force_unit(good(), estimate(1e3, relative))) == told
