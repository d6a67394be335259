"""Entries and tables of the answer from an estimate, each number by its own arithmetic."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline import tables
from pipeline.answer.conformity import (
    axis_values,
    compared,
    expanded,
    largest_force,
    pose_entry,
    tolerance_entry,
)
from pipeline.answer.contract import Odd, Tip, Tolerance
from pipeline.answer.recommended import left_out_mm
from pipeline.answer.stiffness import _budget, _inverted, _odd, budget_entries, stiffness_entry
from pipeline.answer.tables import (
    _errors_table,
    _estimate_table,
    _residuals_table,
    _system_table,
    covariance_table,
    rows_table,
)
from pipeline.diagnosis.average import Springs
from pipeline.machine.robot import load
from pipeline.prediction.decision import Decision
from pipeline.prediction.tolerance import JudgedTolerance, TipDeflection
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system.estimate import solve
from tests.made_system import any_system, dense

RAIL = load("kr500_rail")
PASS, OPEN, FAIL = Decision.PASS, Decision.UNDECIDED, Decision.FAIL


def springs(value: list[float], std: list[float], known: list[bool] | None = None) -> Springs:
    """Compliances with their standard uncertainties; intervals of two of these."""
    x, u = np.array(value), np.array(std)
    found = np.ones(len(x), bool) if known is None else np.array(known)
    return Springs(x, np.diag(u**2), x - 2 * u, x + 2 * u, found)


def test_a_stiffness_is_the_inverse_of_its_compliance() -> None:
    """With k = 1/x, u(k) = u(x)/x^2, the interval inverted end by end; units of the joint."""
    found = springs([2e-8, 4e-7], [1e-9, 1e-8])
    for k, (unit, inverse) in enumerate((("N/m", "m/N"), ("N m/rad", "rad/(N m)"))):
        one = stiffness_entry(RAIL.joints[k], found, k, (), "E1")
        x, u = found.value[k], found.std[k]
        assert (one.value, one.std) == (pytest.approx(1 / x), pytest.approx(u / x**2))
        assert one.ci95 == (pytest.approx(1 / (x + 2 * u)), pytest.approx(1 / (x - 2 * u)))
        assert (one.unit, one.compliance_unit) == (unit, inverse)
        assert (one.compliance, one.compliance_std) == (x, pytest.approx(u))
        assert one.relative_std == pytest.approx(u / x) == pytest.approx(one.std / one.value)
        assert (one.joint, one.joint_name, one.axis) == (k + 1, RAIL.joints[k].name, "E1")
        assert one.name == f"k_{RAIL.joints[k].name}"
        assert one.nominal == RAIL.joints[k].stiffness
        assert (one.joint_type == "prismatic") == (k == 0)


def test_a_stiffness_that_is_not_determined_has_no_value() -> None:
    """Unknown, infinite or negative; what is known of its compliance stays."""
    found = springs([2e-8, 4e-7, -3e-7], [1e-9, np.inf, 1e-8], [False, False, True])
    every = [stiffness_entry(RAIL.joints[k], found, k, (), None) for k in range(3)]

    assert [one.value for one in every] == [one.std for one in every] == [None] * 3
    assert [one.relative_std for one in every] == [None] * 3
    assert [one.identifiable for one in every] == [False, False, True]
    assert [one.compliance for one in every] == [2e-8, None, -3e-7]


@pytest.mark.parametrize(
    ("low", "high", "stiffness"),
    [(2.0, 4.0, (0.25, 0.5)), (0.0, 4.0, (0.25, None)), (-1.0, 4.0, (0.25, None)),
     (2.0, np.inf, (None, 0.5)), (-2.0, -1.0, (None, None)), (-2.0, 0.0, (None, None))],
)  # fmt: skip
def test_an_interval_is_inverted_where_it_has_ends(
    low: float, high: float, stiffness: tuple[float | None, float | None]
) -> None:
    """A compliance that may be zero has a stiffness without an upper limit."""
    assert _inverted(low, high) == stiffness


@pytest.mark.parametrize(
    ("x", "u", "known", "idle", "partners", "odd"),
    [
        (10.0, 1.0, True, False, [], None),
        (10.0, 1.0, True, True, [1], Odd.NO_LEVER),
        (-10.0, 1.0, True, False, [1], Odd.NEGATIVE),
        (10.0, np.inf, False, False, [1], Odd.TOGETHER),
        (10.0, np.inf, False, False, [], Odd.MIXED),
        (10.0, 1.0, False, False, [], Odd.UNCERTAIN),
        (1.0, 1.0, True, False, [], Odd.MAY_BE_ZERO),
    ],
)
def test_what_is_odd_of_a_spring(
    x: float, u: float, known: bool, idle: bool, partners: list[int], odd: Odd | None
) -> None:
    """The first that holds, from a joint that no pull loads to one that may be rigid."""
    assert _odd(springs([x], [u], [known]), 0, idle, partners) == odd


def test_an_interval_to_zero_beside_a_well_known_value_is_that_of_a_cause() -> None:
    """Wider than two standard uncertainties: another cause may take all of it."""
    for x, odd in ((10.0, Odd.ZERO_BESIDE_A_CAUSE), (1.9, Odd.MAY_BE_ZERO)):
        wide = Springs(
            1e-8 * np.array([x]), 1e-16 * np.eye(1), np.array([-1e-9]), np.array([1.2e-7]),
            np.array([True]),
        )  # fmt: skip
        assert _odd(wide, 0, False, []) == odd


def test_shares_of_a_budget_sum_to_the_variance() -> None:
    """Standard uncertainty of a stiffness by source; what is left is the choice of the cause."""
    found = springs([2e-8, 4e-7], [1e-9, 1e-8])
    parts = {"tracker": np.array([0.5e-18, 0.36e-16]), "force_gain": np.array([0.2e-18, 0.64e-16])}
    one, two = _budget(found, parts, 0), _budget(found, parts, 1)

    assert [(part.source, pytest.approx(part.share)) for part in one] == [
        *(("tracker", 0.5), ("force_gain", 0.2), ("which_cause", 0.3))
    ]
    assert [part.source for part in two] == ["tracker", "force_gain"]
    for k, each in enumerate((one, two)):
        x, u = found.value[k], found.std[k]
        assert sum(part.std**2 for part in each) == pytest.approx((u / x**2) ** 2)
        assert [part.std for part in each] == pytest.approx(
            [u / x**2 * np.sqrt(part.share) for part in each]
        )
    assert _budget(springs([2e-8], [1e-9], [False]), parts, 0) == ()
    assert _budget(springs([-2e-8], [1e-9]), parts, 0) == ()
    assert _budget(springs([2e-8], [0.0]), parts, 0) == ()
    joints = [stiffness_entry(RAIL.joints[k], found, k, b, None) for k, b in enumerate((one, two))]
    rows = {row["source"]: row for row in budget_entries(joints)}
    names = [f"{joint.name} [%]" for joint in joints]
    assert [rows["force gain"][name] for name in names] == pytest.approx([20, 64])
    assert rows["which cause"] == {"source": "which cause", names[0]: pytest.approx(30)}


def test_tables_hold_the_system_row_by_row() -> None:
    """B, c and G of the system and its estimate, put together again from their tables."""
    system = any_system(np.random.default_rng(4), 4, 3)
    estimate = solve(system, system.typical)
    B = _system_table(system)
    names = [p.name for p in system.parameters]
    np.testing.assert_array_equal(B[[f"B_{name}" for name in names]], system.B)
    np.testing.assert_array_equal(B["c_m"], system.c)
    rows = rows_table(system)
    assert rows["row"].tolist() == [*range(40)]
    assert rows["axis"].tolist() == ["xyz"[k] for k in system.rows.axis]
    np.testing.assert_array_equal(rows["pose"], system.rows.pose)
    errors = _errors_table(system)
    G = np.zeros((40, errors["error"].max() + 1))
    G[errors["row"], errors["error"]] = errors["value_m"]
    np.testing.assert_allclose(G @ G.T, dense(system))
    of = errors.groupby("error")[["source", "common"]].first()
    assert of["source"].tolist() == [*["tracker"] * 40, *["force_gain"] * 2]
    assert of["common"].tolist() == [False] * 40 + [True] * 2

    off = np.arange(40.0)
    table = _residuals_table(system, estimate, off)
    W = np.linalg.inv(np.linalg.cholesky(dense(system)))
    assert np.sum(table["whitened"] ** 2) == pytest.approx(np.sum((W @ estimate.residual) ** 2))
    np.testing.assert_allclose(table["residual_m"], estimate.residual)
    assert table["left_out_m"].tolist() == off.tolist()
    found = _estimate_table(system.parameters, estimate)
    assert found["value"].tolist() == estimate.value.tolist()
    assert found["std"].tolist() == estimate.std.tolist()
    cov = tables.conform(
        covariance_table(system.parameters, estimate.cov), tables.covariance(system.parameters)
    )
    np.testing.assert_array_equal(tables.frame(cov)[names], estimate.cov)


def test_without_a_stated_noise_residuals_are_whitened_by_their_scatter() -> None:
    """Their sum of squares is the number of degrees of freedom."""
    system = replace(any_system(np.random.default_rng(4), 3, 3), noise_stated=False)
    estimate = solve(system, system.typical)
    table = _residuals_table(system, estimate, np.zeros(40))
    assert np.sum(table["whitened"] ** 2) == pytest.approx(estimate.dof) == pytest.approx(37)
    for dof in (0, 1):
        left = SimpleNamespace(residual=estimate.residual, dof=dof)
        table = _residuals_table(system, left, np.zeros(40))
        assert np.sum(table["whitened"] ** 2) == pytest.approx(1)


def test_the_left_out_error_is_that_of_the_rows_that_were_predicted() -> None:
    """Rms in millimetres; none where no pose is predicted by the others."""
    assert left_out_mm(np.array([3e-3, np.nan, -4e-3])) == pytest.approx(np.sqrt(12.5))
    assert left_out_mm(np.full(2, np.nan)) is None


def judged(
    size: list[float], std: list[float], path: pd.DataFrame | None = None
) -> JudgedTolerance:
    """Deflections along x [m]."""
    moved = np.column_stack([size, np.zeros((len(size), 2))])
    return JudgedTolerance(TipDeflection(moved, np.array(size), np.array(std)), path)


def test_a_test_pose_is_stated_in_axes_of_the_controller() -> None:
    """Metres and degrees; force and deflection with their units."""
    axes = np.array([8.5, *np.deg2rad([10, -80, 70, 20, 30, 40])])
    q = RAIL.controller_matrix @ axes + RAIL.controller_offset
    where = PoseOfInterest(q, np.array([30.0, -40.0, 0.0]), stated=False)
    found = pose_entry(RAIL, where, judged([2e-3], [1e-4]))

    assert [(one.name, one.unit) for one in found.axes] == [
        (name, "m" if k == 0 else "deg") for k, name in enumerate(RAIL.controller)
    ]
    assert [one.value for one in found.axes] == pytest.approx([8.5, 10, -80, 70, 20, 30, 40])
    assert axis_values(RAIL, q) == found.axes
    fine = RAIL.controller_matrix @ (axes + 1e-10 * np.eye(7)[0] * 4) + RAIL.controller_offset
    assert axis_values(RAIL, fine)[0].value == 8.5  # a picometre is rounding
    assert (found.deflection_mm, found.std_mm) == (pytest.approx(2), pytest.approx(0.1))
    assert found.force_n == (30, -40, 0)
    assert found.vector_mm == pytest.approx((2, 0, 0))
    assert found.along_force_mm == pytest.approx(2 * 0.6)
    assert not found.stated


def test_a_path_is_decided_stretch_by_stretch() -> None:
    """Each with its largest deflection; the test pose only if it was stated."""
    rows = pd.DataFrame(
        {"pose": [4, 5, 8, 9],
         "fx_n": [3.0, 30, 6, 0], "fy_n": [4.0, 40, 8, 0], "fz_n": [0.0, 0, 0, 7],
         "deflection_m": [1e-3, 3e-3, 9e-3, 8e-3], "std_m": [1e-4, 2e-4, 3e-4, 4e-4],
         "decision": ["pass", "pass", "fail", "undecided"]}
    )  # fmt: skip
    asked = SimpleNamespace(deflection_mm=5.0, path="p.csv")
    for stated in (True, False):
        where = PoseOfInterest(np.zeros(7), np.ones(3), stated=stated)
        found = tolerance_entry(asked, where, judged([4e-3], [1e-4], rows))
        assert found.test_pose == (PASS if stated else None)
        assert found.deflection_mm == 5
    path = found.path
    assert (path.file, path.points, path.force_n) == ("p.csv", 4, (5.0, 50.0))
    assert path.decision is FAIL
    assert [(s.decision, s.first, s.last, s.points, s.at) for s in path.stretches] == [
        *((PASS, 4, 5, 2, 5), (FAIL, 8, 8, 1, 8), (OPEN, 9, 9, 1, 9))
    ]
    assert [s.deflection_mm for s in path.stretches] == pytest.approx([3, 9, 8])
    assert [s.std_mm for s in path.stretches] == pytest.approx([0.2, 0.3, 0.4])
    tight = SimpleNamespace(deflection_mm=3.0, path=None)
    assert tolerance_entry(tight, PoseOfInterest(np.zeros(7), np.ones(3), stated=True),
                           judged([4e-3], [1e-4])).test_pose == FAIL  # fmt: skip
    bare = SimpleNamespace(deflection_mm=5.0, path=None)
    assert tolerance_entry(bare, where, judged([4e-3], [1e-4])).path is None
    assert tolerance_entry(None, where, judged([4e-3], [1e-4])) is None


@pytest.mark.parametrize("seed", range(3))
def test_printed_limits_agree_with_the_decision(seed: int) -> None:
    """Of 200 deflections near the limit: the printed sum is right, and on the decided side."""
    rng = np.random.default_rng(seed)
    for d, u in zip(rng.uniform(0.8, 1.2, 200), 10 ** rng.uniform(-3, -1, 200), strict=True):
        low, high = d - 1.65 * u, d + 1.65 * u
        decision = PASS if high <= 1 else FAIL if low > 1 else OPEN
        said = compared(Tip(deflection_mm=d, std_mm=u), decision, 1.0)
        numbers = [float(word) for word in said.replace("mm", "").split() if word[0].isdigit()]
        if decision is OPEN:
            value, guard, std, below, above, _ = numbers
            assert below <= 1 < above
            assert (below, above) == (
                pytest.approx(value - guard * std, abs=2e-3),
                pytest.approx(value + guard * std, abs=2e-3),
            )
        else:
            value, guard, std, limit, _ = numbers
            assert limit == pytest.approx(high if decision is PASS else low, abs=2e-2 * u + 1e-3)
            assert (limit <= 1) == (decision is PASS)
        assert guard == 1.65
        assert (value, std) == (pytest.approx(d, abs=0.06 * u + 1e-9), pytest.approx(u, rel=0.06))


def test_the_largest_force_keeps_the_tolerance_exactly() -> None:
    """F (T - 1.65 u) / d: with it d + 1.65 u is T; none if no force or any would do."""
    asked = Tolerance(deflection_mm=1.0, test_pose=FAIL, path=None)
    pose = Tip(deflection_mm=2.0, std_mm=0.1)
    force = largest_force(asked, pose, 3000.0)

    assert 2.0 * force / 3000 + 1.65 * 0.1 == pytest.approx(1.0)
    assert largest_force(asked, Tip(deflection_mm=2.0, std_mm=0.7), 3e3) is None
    assert largest_force(asked, Tip(deflection_mm=0.5, std_mm=0.1), 3e3) is None
    assert largest_force(asked, Tip(deflection_mm=2.0, std_mm=None), 3e3) is None
    for decision in (PASS, None):
        fine = Tolerance(deflection_mm=1.0, test_pose=decision, path=None)
        assert largest_force(fine, pose, 3e3) is None
    assert expanded(pose) == "2.00 mm, U = 0.20 mm (k = 2)"
    assert "unknown uncertainty" in expanded(Tip(deflection_mm=2.0, std_mm=None))
