"""Statistics and judgements of a diagnosis, each against dense algebra or plain arithmetic."""

from dataclasses import dataclass, replace
from types import SimpleNamespace as Some

import numpy as np
import pytest
from linear_campaign import FREE, made, suspect
from scipy import stats
from scipy.sparse import csr_array

from pipeline.diagnosis import average, bounds, causes, converge, drift, noise_bounds, unlisted
from pipeline.diagnosis.agreement import ChiSquare, SpringAgreement
from pipeline.diagnosis.blindspots import smallest_visible, unnoticed, visible
from pipeline.diagnosis.facts import Bounds, CrossValidation, Drift, Facts
from pipeline.diagnosis.isolability import Twins, _compare
from pipeline.diagnosis.suspect_statistics import misfits, suspect_statistics
from pipeline.diagnosis.unloaded_geometry import _down
from pipeline.machine.cell import Tool, baseline, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import catalogue, joint_offset
from pipeline.machine.robot import load
from pipeline.system.outlying import OutlyingReadings
from pipeline.system.system import Errors, Goodness, RowIndex, ScatterRatio, System

KR500 = load("kr500_rail")
EFFECTS = {one.label: one for one in catalogue(KR500)}


# --- statistics -----------------------------------------------------------------------------------

ALIKE = (suspect("a", FREE, location="arm"), suspect("b", FREE, FREE, location="arm"),
         suspect("c", FREE, location="rail"))  # fmt: skip


def projected(X, columns):
    """What is left of columns beside others."""
    return columns - X @ np.linalg.lstsq(X, columns, rcond=None)[0]


def test_a_place_has_the_share_that_its_columns_explain():
    """Of all its suspects at once, by numpy; the smallest p first, by scipy's F."""
    one = made(np.random.default_rng(3), ALIKE, {2: [4.0]})
    view, X, y = one.view(), one.columns(), one.y
    found = misfits(view)

    rest = np.sum(projected(X, y[:, None]) ** 2)
    dof = len(y) - X.shape[1]
    expected = {}
    for place, which in (("arm", (0, 1)), ("rail", (2,))):
        drop = rest - np.sum(projected(one.columns(*which), y[:, None]) ** 2)
        k = one.columns(*which).shape[1] - X.shape[1]
        F = (drop / k) / ((rest - drop) / (dof - k))
        expected[place] = drop / rest, stats.f.sf(F, k, dof - k)
    assert [each.place for each in found] == ["rail", "arm"]
    for each in found:
        assert each.share == pytest.approx(expected[each.place][0], rel=1e-6)
        assert each.p_value == pytest.approx(expected[each.place][1], rel=1e-3)


def test_a_cause_is_absorbed_by_as_much_as_springs_imitate_it():
    """1 - |(I - P) D|^2 / |D|^2, between zero and one; seen by what is left."""
    one = made(np.random.default_rng(4), ALIKE, {0: [2.0]})
    one.Z[2][:, 0] = 0.98 * one.B[:, 0] * 1.5 + 0.02 * one.Z[2][:, 0]
    one.Z[1][:] *= 0.0
    view = one.view()
    now = view.beside(view.base)
    scores = Some(
        p=lambda: np.array([1e-9, 0.5, 0.2]), log_evidence=np.array([9.0, -1.0, 0.5]),
        whole=now.whole, N=now.N,
    )  # fmt: skip
    told = suspect_statistics(Some(first=view, scores=scores, threshold=Some(p=1e-3)))

    assert [each.effect.label for each in told] == ["a", "b", "c"]
    assert [each.p_value for each in told] == [1e-9, 0.5, 0.2]
    assert [each.log_evidence for each in told] == [9.0, -1.0, 0.5]
    X = one.columns()
    for k in (0, 2):
        D = one.columns(k)[:, [-1]]
        left = np.sum(projected(X, D) ** 2)
        assert told[k].absorbed == pytest.approx(1 - left / np.sum(D**2), abs=1e-9)
        least = stats.chi2.isf(1e-3, 1)
        size = told[k].smallest_visible
        assert stats.ncx2.sf(least, 1, size**2 * left) == pytest.approx(0.8, rel=1e-6)
    assert told[1].absorbed == 1.0  # it moves nothing
    assert told[1].smallest_visible == np.inf
    assert np.isnan(smallest_visible(one.view((0,)), one.view((0,)).base, 1e-3)[0])


def test_of_several_forms_the_likeliest_is_stated_with_the_size_of_the_clearest():
    """They share a label."""
    forms = (suspect("a", FREE), suspect("a", FREE), suspect("b", FREE))
    one = made(np.random.default_rng(5), forms, {})
    one.Z[1][:] *= 3.0
    view = one.view()
    now = view.beside(view.base)
    scores = Some(p=lambda: np.array([0.1, 0.2, 0.3]), log_evidence=np.array([2.0, 1.0, 0.0]),
                  whole=now.whole, N=now.N)  # fmt: skip
    told = suspect_statistics(Some(first=view, scores=scores, threshold=Some(p=1e-3)))
    assert [each.p_value for each in told] == [0.1, 0.3]
    seen = visible(view.M, view.base, view.at, 1e-3)
    assert seen[1] < seen[0]
    assert told[0].smallest_visible == pytest.approx(seen[1])


def test_blind_spots_are_what_a_usual_size_would_not_have_shown():
    """Least visible first; what is seen elsewhere counts, and twins of the springs never do."""
    few = (suspect("a", FREE), suspect("b", FREE), suspect("c", FREE), suspect("d", FREE))
    one = made(np.random.default_rng(6), few[:2], {})
    one.Z[0][:] *= 1e-3
    one.Z[1][:] *= 1e3
    view = one.view()
    hidden, shown = unnoticed(
        few, view, view.base, 1e-3, Twins(("d",), (), ()), {"c": 0.5, "a": 400.0}
    )
    size = min(visible(view.M, view.base, view.at, 1e-3)[0], 400.0)
    assert [(each.effect.label, each.times) for each in hidden] == [("d", np.inf), ("a", size)]
    assert [each.effect.label for each in shown] == ["b", "c"]
    assert shown[1].smallest_visible == pytest.approx(0.5 * 2e-8)
    assert "about the axis of a joint" in hidden[0].why
    assert hidden[0].smallest_visible is None
    assert hidden[1].smallest_visible == pytest.approx(size * 2e-8)
    assert f"{1 / size:.2g} of what would be seen" in hidden[1].why


def test_signatures_are_compared_beside_the_springs():
    """One that springs imitate, one that moves nothing, two that are alike up to them."""
    rng = np.random.default_rng(8)
    B, Z = rng.normal(size=(40, 3)), rng.normal(size=(40, 2))
    every = {0: Z, 1: Z @ [[2.0, 1], [0, -1]] + B[:, :2], 2: B[:, [0]] + 2 * B[:, [2]],
             3: 1e-14 * Z, 4: Z[:, [0]], 5: rng.normal(size=(40, 2))}  # fmt: skip
    found = _compare([Some(label=name) for name in "abcdef"], B, every)
    assert found == Twins(("c",), (("a", "b"),), ("d",))
    assert (found.of("b"), found.of("c")) == (("a",), ())


# --- averages -------------------------------------------------------------------------------------


def estimated(weight, values, N):
    """A hypothesis with springs of these values and this information, in typical sizes."""
    parameters = tuple(p for one in baseline(KR500) for p in one.parameters)
    n = len(values)
    typical = np.array([p.typical for p in parameters[:n]])
    return Some(
        weight=weight, cell=Some(robot=Some(n=n)),
        estimate=Some(value=values * typical, parameters=parameters[:n], quantile=1.96),
        N=N,
    )  # fmt: skip


def information(each, monkeypatch):
    """Information over hypotheses of which each determines what its V is finite for."""
    monkeypatch.setattr(average, "_informations", lambda all_: np.stack([one.N for one in all_]))
    return average.information(each)


def test_information_over_hypotheses_is_that_of_their_mixture(monkeypatch):
    """V of a mixture is the mean of V_h and of the squares of what is apart; N its inverse."""
    rng = np.random.default_rng(2)
    N, values = [], rng.normal(size=(3, 4))
    for _ in range(3):
        half = rng.normal(size=(4, 4)) + 3 * np.eye(4)
        N.append(half @ half.T)
    w = np.array([0.5, 0.3, 0.2])
    each = [estimated(*one) for one in zip(w, values, N, strict=True)]
    off = values - w @ values
    V = np.einsum("h,hij->ij", w, [np.linalg.inv(one) for one in N])
    V = V + np.einsum("h,hi,hj->ij", w, off, off)
    np.testing.assert_allclose(information(each, monkeypatch), np.linalg.inv(V), rtol=1e-8)
    np.testing.assert_allclose(information(each[:1], monkeypatch), N[0])


def test_what_one_hypothesis_leaves_open_has_no_information(monkeypatch):
    """Along it there is none, and across it that of the mixture there."""
    rng = np.random.default_rng(3)
    R = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    lacking = R[:, 1:] @ np.diag([5.0, 7, 9]) @ R[:, 1:].T  # nothing along the first
    half = rng.normal(size=(4, 4)) + 3 * np.eye(4)
    whole = half @ half.T
    same = np.ones(4)
    each = [estimated(0.5, same, lacking), estimated(0.5, same, whole)]
    found = information(each, monkeypatch)
    across = R[:, 1:]
    V = 0.5 * np.diag([1 / 5, 1 / 7, 1 / 9]) + 0.5 * across.T @ np.linalg.inv(whole) @ across
    np.testing.assert_allclose(found, across @ np.linalg.inv(V) @ across.T, atol=1e-8)


# --- causes ---------------------------------------------------------------------------------------


def test_scatter_is_a_cause_where_contrasts_show_it():
    """By how much it exceeds what is stated; that of the scale by both factors."""
    noises = (EFFECTS["tracker_noise"], EFFECTS["force_noise"], EFFECTS["tool_flex"])
    spread = ScatterRatio(1.5, 0.1, 1e-9, 2.0, 0.2, 1e-8, "contrasts")
    found = causes.of_scatter(noises, spread)

    assert [one.effect.name for one in found] == ["tracker_noise", "force_noise"]
    for one, size, std, p in zip(found, (0.5, 2.0), (0.1, 0.3), (1e-9, 1e-8), strict=True):
        (told,) = one.amplitudes
        assert (told.value, told.std, one.p_value) == pytest.approx((size, std, p))
        assert told.ci95 == pytest.approx((size - 1.96 * std, size + 1.96 * std), rel=1e-3)
        assert one.probability > 0.99
    assert causes.of_scatter(noises, replace(spread, known_from="residuals")) == ()
    quiet = replace(spread, tracker_p=0.5)
    assert [one.effect.name for one in causes.of_scatter(noises, quiet)] == ["force_noise"]


def moved(**more):
    """A drift of the tracker."""
    return Drift(
        effect=next(one for one in EFFECTS.values() if one.name == "tracker_drift"),
        velocity=np.array([1e-8, 0, -2e-8]), std=np.full(3, 1e-9), turn=np.zeros(3),
        turn_std=np.ones(3), moved_m=1e-4, hours=2.0, p_value=1e-12, named=True, undecided=False,
        visible=1.0, **more,
    )  # fmt: skip


def test_a_drift_of_the_base_is_told_once():
    """Not beside one in the displacements; a knock that looks the same takes from its odds."""
    (one,) = causes.of_base(moved(), ())
    assert [size.value for size in one.amplitudes] == [1e-8, 0, -2e-8]
    assert one.p_value == 1e-12
    (doubted,) = causes.of_base(replace(moved(), undecided=True), ())
    assert doubted.probability < one.probability
    assert causes.of_base(moved(), (one,)) == ()
    assert causes.of_base(replace(moved(), named=False), ()) == ()
    assert causes.of_base(None, ()) == ()


def test_growth_is_told_by_its_largest_value():
    """Of either sign, with its own uncertainty."""
    grown = Some(begun=np.array([0.0, 3600, 7200]), growth=np.array([0.0, -5e-5, 3e-5]),
                 std=np.array([0.0, 2e-6, 1e-6]), p_value=1e-7)  # fmt: skip
    (one,) = causes.of_growth(replace(moved(), grown=grown))
    assert (one.amplitudes[0].value, one.amplitudes[0].std) == (-5e-5, 2e-6)
    assert one.p_value == 1e-7
    assert causes.of_growth(moved()) == ()
    assert causes.of_growth(None) == ()


def test_a_motion_that_base_and_unloaded_positions_show_is_one():
    """A drift if the rounds tell it, else the knock; without either all stays as it is."""
    knock, other = Some(effect=Some(name="base_moved")), Some(effect=Some(name="joint_offset"))
    both, alone = (knock, other), (other,)

    def told(found, seen):
        stood = Some(believed=True, gain=None, causes=[
            Some(effect=one.effect, probability=1.0, value=[], std=[], p_value=0.0, rivals=(),
                 twins=()) for one in found
        ])  # fmt: skip
        for one in found:
            one.effect.parameters = ()
        kept, left = causes.of_motion(stood, seen)
        return [one.effect.name for one in kept], left

    seen = moved()
    kept, left = told(both, seen)
    assert (kept, left is seen) == (["joint_offset"], True)
    for unsure in (
        replace(moved(), undecided=True),
        replace(moved(), named=False, knocked=("a", "b")),
    ):
        kept, left = told(both, unsure)
        assert kept == ["base_moved", "joint_offset"]
        assert (left.named, left.undecided, left.knocked) == (False, False, None)
        kept, left = told(alone, unsure)
        assert (kept, left is unsure) == (["joint_offset"], True)
    assert told(both, None) == (["base_moved", "joint_offset"], None)


@pytest.mark.parametrize("p", [0.2, 1e-3, 1e-8])
def test_what_rejects_the_model_by_the_smallest_p_speaks_for_something_missing(p):
    """Whichever test it is; nothing speaks for it where none does."""
    one = Some(explains=False, left=1.0, threshold=Some(independent=10.0),
               lack=Some(p_poses=1.0, p_pulls=1.0))  # fmt: skip
    each = [
        (Some(**vars(one) | {"lack": Some(p_poses=p, p_pulls=1.0)}), 1.0),
        (Some(**vars(one) | {"lack": Some(p_poses=1.0, p_pulls=p)}), 1.0),
        (Some(**vars(one) | {"left": 1 - (1 - p) ** 0.1}), 1.0),
        (one, p),
    ]
    found = [causes.missing(*both) for both in each]
    assert found == pytest.approx([found[0]] * 4, rel=1e-5)
    assert found[0] > causes.missing(one, 0.3)
    assert causes.missing(Some(**vars(one) | {"explains": True}), 0.5) == 0.0
    assert causes.missing(Some(**vars(one) | {"explains": True}), 1e-9) > 0.0


# --- facts ----------------------------------------------------------------------------------------


def test_springs_disagree_by_the_smaller_p_of_two_kinds():
    """Twice it where both exist; the joint where the difference is most significant."""
    weight, pulls = (np.array([[1.0, 0.1], [2.0, np.inf], [3.0, 0.3]]),
                     np.array([[1.3, 0.1], [9.0, 0.1], [2.0, 0.1]]))  # fmt: skip
    one = SpringAgreement(8.0, 3, weight, pulls, None)
    assert one.p == pytest.approx(stats.chi2.sf(8.0, 3))
    assert one.most == (2, pytest.approx(2 / 3))
    both = replace(one, elements=ChiSquare(12.0, 2))
    assert both.p == pytest.approx(2 * stats.chi2.sf(12.0, 2))
    assert replace(one, chi2=0.1, elements=ChiSquare(0.1, 2)).p == 1.0
    assert replace(one, dof=0).p == 1.0


def test_moved_causes_are_errors_of_files_or_changes_or_the_machines_own():
    """What set in during the campaign is no error of a file, and neither is what bends."""
    bends = next(one for one in EFFECTS.values() if one.name == "gravity_sag")
    plain = EFFECTS["joint_offset:3"]
    late = joint_offset.since(KR500, 2, (1, 2, 3), 4)
    each = tuple(Some(effect=one) for one in (late, plain, bends))
    facts = replace(Facts(False, True), moved=each)
    assert facts.changed == each[:1]
    assert facts.misdescribed == each[1:2]


def gained(reduction, low):
    """A cross-validation."""
    return CrossValidation(np.ones(1), np.ones(1), reduction, (low, 0.9), ())


@pytest.mark.parametrize(
    ("reduction", "low", "told", "helps"),
    [(0.2, -0.1, True, True), (0.2, -0.1, False, False), (0.2, 0.1, False, True),
     (-0.2, -0.3, True, False)],
)  # fmt: skip
def test_causes_help_with_certainty_where_only_residuals_tell_the_scatter(
    reduction, low, told, helps
):
    """Elsewhere by the estimate; without cross-validation they are believed."""
    facts = Facts(True, True)
    assert facts.helps
    assert replace(facts, gain=gained(reduction, low), scatter_told=told).helps == helps


# --- bounds ---------------------------------------------------------------------------------------


def test_bounds_are_kept_by_tracker_scale_and_model():
    """Ten times the stated noise, a quarter of the squares, one far reading of a pose."""
    assert not Bounds().faulty
    assert Bounds(tracker=10.1).faulty
    assert Bounds(force=10.1).faulty
    assert not Bounds(tracker=9.9, force=9.9).faulty
    assert Bounds(left=0.24).predicts
    assert not Bounds(left=0.26).predicts
    assert not Bounds(determined=False).predicts
    some = np.array([4, 7])
    for count, base, p, scattered in (
        (2, 0, 1e-9, True), (1, 0, 1e-9, False), (0, 1, 1e-9, True), (2, 0, 0.5, False),
    ):  # fmt: skip
        far = OutlyingReadings(some[:count], some[:count], p, base)
        assert Bounds(far=far).scattered == scattered
    assert bounds.FAULTY == 10.0


def rows(values, pose, target):
    """A system of one spring that moves every row alike, and its estimate."""
    n = len(values)
    at = np.asarray(pose)
    index = RowIndex(at, at, np.array(target, object), np.arange(n) % 3, at)

    G = Errors(csr_array(1e-5 * np.eye(n)), np.full(n, "tracker", object), np.zeros(n, bool))
    parameter = baseline(KR500)[0].parameters[0]
    B = np.ones((n, 1)) / parameter.typical * 1e-4
    c = np.asarray(values, float)
    x = np.linalg.lstsq(B, c, rcond=None)[0]
    system = System((parameter,), index, B, c, G, True)
    return system, Some(residual=c - B @ x, dof=n - 1, goodness=Goodness(1.0, n - 1, 0.5))


def test_the_worst_residual_is_that_of_one_target_in_one_pose():
    """Root of the mean square over its rows, times three axes."""
    residual = np.array([1.0, 1, 1, 2, 0, 0, 0, 3, 0]) * 1e-4
    system, estimate = rows(residual, [4] * 6 + [12] * 3, ["P1"] * 3 + ["P 2"] * 3 + ["P1"] * 3)
    estimate.residual = residual
    pose, target, worst_m = noise_bounds._worst(system, estimate)
    assert (pose, target) == (12, "P1")
    assert worst_m == pytest.approx(3e-4)


def test_a_model_is_determined_if_it_explains_more_than_chance():
    """By chi-square with the stated noise, or with that of the residuals."""
    rng = np.random.default_rng(3)
    for lift in (0.0, 0.5, 1.0, 5.0):
        system, estimate = rows(1e-5 * (lift + rng.normal(size=12)), np.arange(12) // 3, ["P"] * 12)
        drop = (np.sum(system.c**2) - np.sum(estimate.residual**2)) / 1e-10
        p = stats.chi2.sf(drop, 1)
        assert noise_bounds._determined(system, estimate) == (p < 2.7e-3)
        unstated = replace(system, noise_stated=False)
        s2 = np.sum(estimate.residual**2) / 1e-10 / 11
        assert noise_bounds._determined(unstated, estimate) == (
            stats.chi2.sf(drop / s2, 1) < 2.7e-3
        )


def test_what_is_left_is_a_fraction_beyond_the_noise():
    """Noise of readings and zeros is taken off, if it is stated; never less than nothing."""
    data = Some(delta=np.array([[3e-3, 4e-3, 0]]), loaded_cov=1e-6 * np.eye(3)[None],
                zero_cov=2e-6 * np.eye(3)[None], noise_stated=True)  # fmt: skip
    right, estimate = Some(reduced=Some(data=data)), Some(residual=np.array([4e-3, 0, 0]))
    assert noise_bounds._left(right, None, estimate) == pytest.approx((16 - 9) / 25)
    data.noise_stated = False
    assert noise_bounds._left(right, None, estimate) == pytest.approx(16 / 25)
    data.noise_stated, estimate.residual = True, np.array([1e-3, 0, 0])
    assert noise_bounds._left(right, None, estimate) == 0.0
    data.delta = np.zeros((1, 3))
    assert noise_bounds._left(right, None, estimate) == 1.0


# --- base rounds, laws, gravity -------------------------------------------------------------------


def test_rows_are_summed_by_their_number():
    """Column by column; a number without rows has zeros."""
    table, which = np.arange(8.0).reshape(4, 2), np.array([2, 0, 2, 0])
    assert drift._sums(table, which).tolist() == [[8, 10], [0, 0], [4, 6]]


def test_laws_of_a_place_share_their_least_chance_and_a_few_are_kept():
    """In their order: so many forms of each of so many places."""
    laws = [Some(label=name) for name in "abacbdaeafagahij"]
    chance = np.linspace(1.0, 0.1, len(laws))
    least = unlisted._least_of_place(laws, chance)
    for k, one in enumerate(laws):
        assert least[k] == min(c for c, other in zip(chance, laws, strict=True)
                               if other.label == one.label)  # fmt: skip
    kept = [laws[i].label for i in unlisted._with_room(laws, range(len(laws)))]
    assert len(set(kept)) == unlisted._MOST
    assert kept.count("a") == min(unlisted._FORMS, 6)
    assert list(dict.fromkeys(kept)) == list("abcdef")
    again = list(unlisted._with_room(laws, range(len(laws) - 1, -1, -1)))
    assert again == sorted(again, reverse=True)


@pytest.mark.parametrize("n", [2, 3, 5, 9, 14])
def test_signs_of_poses_are_never_all_alike(n):
    """Of few poses every pattern once up to its sign."""
    signs = unlisted._signs(n, np.random.default_rng(1))
    assert set(np.unique(signs)) == {-1.0, 1.0}
    assert signs.shape[1] == n
    if n <= 9:
        assert (np.abs(signs.sum(axis=1)) < n).all()
        up_to_sign = {tuple(one * one[-1]) for one in signs}
        assert len(up_to_sign) == len(signs) == min(2 ** (n - 1) - 1, unlisted._FLIPS)


def test_gain_in_likelihood_has_schwarz_penalty():
    """-n/2 ln(1 - share) - k/2 ln n; all of the squares is no infinite gain."""
    found = unlisted._likelihood(np.array([0.0, 0.5, 1.0]), np.array([1, 2, 1]), 40)
    assert found[:2] == pytest.approx([-0.5 * np.log(40), 20 * np.log(2) - np.log(40)])
    assert np.isfinite(found[2])


@pytest.mark.parametrize("axis", ["+x", "-y", "-z", None])
def test_gravity_is_told_along_the_axis_that_explains_the_sag(axis, monkeypatch):
    """If that is certainly likelier than what is stated, and the arm then hangs."""
    place = "pipeline.diagnosis.unloaded_geometry"
    monkeypatch.setattr(f"{place}.products", lambda about: about)
    monkeypatch.setattr(f"{place}.off", lambda zeros, mean: 1e-4)

    def unrefined(other, gravity):
        way = f"{'+-'[bool(min(gravity) < 0)]}{'xyz'[int(np.argmax(np.abs(gravity)))]}"
        assert np.linalg.norm(gravity) == pytest.approx(9.7)
        likely = 15.0 if way == axis else 5.0
        return Some(log_evidence=likely + (100.0 if not other.weighs else 0.0), mean=None)

    monkeypatch.setattr(f"{place}.unrefined", unrefined)

    class Robot:
        """A robot on which gravity acts."""

        def __init__(self, gravity):
            self.gravity = gravity

        def under(self, gravity):
            """The same in another direction."""
            return Robot(gravity)

    def fake(zeros, **changes):
        return Stood(**vars(zeros) | changes)

    class Stood(Some):
        """Unloaded positions."""

        columns = Some(count=2)

        def about(self, _):
            """Their rows, here only the direction of gravity."""
            return self.robot.gravity

        def hangs(self, _):
            """The links weigh something."""
            return self.heavy

    monkeypatch.setattr(f"{place}.replace", fake)
    for heavy in (True, False):
        stood = Stood(robot=Robot(np.array([0, 0, -9.7])), sag="sag", weighs=False, heavy=heavy)
        told = _down(stood, Some(log_evidence=0.0))
        assert told == ((axis, 1e-4) if axis and heavy else None)
    assert _down(stood, Some(log_evidence=6.0)) is None


# --- what a cause changes, and what is weighed anew -----------------------------------------------

TOOL = Tool(np.array([0.2, 0.1, 0.3]), np.array(["P1", "P2"], object), np.eye(3)[:2] / 5)


def test_a_cause_changes_the_deflection_at_the_test_pose_beside_the_others():
    """Mean over targets; beside none, from what the springs alone predicted."""
    cell, x = paper_cell(KR500, TOOL), KR500.nominal_compliance
    q, force = np.array([3.0, 0.1, -1.2, 1.3, 0.2, 0.4, 0.1]), np.array([100.0, 50, -900])
    first, last = Some(cell=cell, values=x), Some(cell=cell, values=1.5 * x)
    found = Some(first=Some(model=first), view=Some(model=last))
    told = Some(estimated=lambda others, near: Some(cell=cell, values=1.2 * x))
    own = predict(cell, Pulls.at(q, force), x).displacement[0]
    size = np.linalg.norm(own, axis=1).mean()
    where = Some(q=q, force=force)
    assert causes._change(told, found, (), where) == pytest.approx(0.5 * size, rel=1e-6)
    assert causes._change(told, found, (1,), where) == pytest.approx(0.3 * size, rel=1e-6)


def test_the_height_of_a_law_is_that_of_its_own_parameters(monkeypatch):
    """Of the accepted hypothesis, as sized if that is known; causes of the catalogue have none."""
    parameters = tuple(p for one in baseline(KR500) for p in one.parameters)[:5]
    law = Some(law="a law", parameters=parameters[2:4])
    V = np.arange(25.0).reshape(5, 5)
    estimate = Some(parameters=parameters, value=np.arange(5.0), cov=V)
    seen = {}

    def height(of, value, cov):
        seen.update(of=of, value=value.tolist(), cov=cov.tolist())
        return 3.0, 0.5

    monkeypatch.setattr(causes, "height", height)
    for sized in (None, Some(parameters=parameters, value=2 * np.arange(5.0), cov=V)):
        told = causes._height(law, Some(effects=(law,), estimate=estimate, sized=sized))
        assert seen == {"of": "a law", "value": [4.0, 6.0] if sized else [2.0, 3.0],
                        "cov": [[12.0, 13.0], [17.0, 18.0]]}  # fmt: skip
        assert (told.value, told.std) == (3.0, 0.5)
        assert told.ci95 == pytest.approx((3 - 0.98, 3 + 0.98))
        assert (told.parameter.name, told.parameter.lower) == ("amplitude", 0.0)
    assert causes._height(law, Some(effects=(), estimate=estimate, sized=None)) is None
    listed = Some(law=None, parameters=law.parameters)
    assert causes._height(listed, Some(effects=(listed,), estimate=estimate, sized=None)) is None


@dataclass(frozen=True)
class Weighed:
    """A campaign that counts what is done to it."""

    shape: str = "first"
    told: bool = True
    used: bool = False
    taken: bool = False

    plain = property(lambda self: Some(noise_stated=self.told))
    noise = property(lambda self: Some(used=self.used))
    case, reduced = "case", "reduced"

    def shaped(self, found):
        """The same with another shape of the noise."""
        return replace(self, shape=found.name)


def diagnosed(settled, stated=0.5, misfit=0.5):
    """What a diagnosis says of its residuals."""
    return Some(settled=settled, facts=Some(stated_p=stated, misfit_p=misfit))


@pytest.mark.parametrize(
    ("told", "settled", "likely", "differs", "later", "ends"),
    [
        (False, True, True, True, True, "same"), (True, False, False, True, True, "same"),
        (True, True, False, False, True, "kept"), (True, False, True, False, False, "kept"),
        (True, True, False, True, False, "again"), (True, False, True, True, True, "again"),
        (True, False, True, True, False, "same"),
    ],
)  # fmt: skip
def test_a_campaign_is_weighed_by_the_noise_beside_its_model(
    told, settled, likely, differs, later, ends, monkeypatch
):
    """If the model leaves only scatter, or noise is likely anyway and completes the model."""
    later_said = diagnosed(later)
    monkeypatch.setattr(converge, "_noise_likely", lambda *_: likely)
    monkeypatch.setattr(converge, "_diagnosed", lambda *_: later_said)
    monkeypatch.setattr(
        converge, "_beside",
        lambda right, said: Some(name="second" if said is later_said else "found",
                                 differs=lambda shape: differs),
    )  # fmt: skip
    end = converge._Converged("mistakes", Weighed(told=told), "there", diagnosed(settled))
    found = converge._weighed(end, lambda work: work)

    if ends == "same":
        assert found is end
        return
    assert found.screened == "mistakes"
    assert found.diagnosis is (later_said if ends == "again" else end.diagnosis)
    assert found.right.shape.name == ("second" if ends == "again" else "found")


@pytest.mark.parametrize(
    ("stated", "misfit", "used", "refitted"),
    [(1e-9, 0.5, False, True), (1e-9, 1e-9, False, False), (0.5, 0.5, False, False),
     (1e-9, 0.5, True, False), (None, 0.5, False, False)],
)  # fmt: skip
def test_the_scale_of_contrasts_is_taken_where_only_the_stated_noise_is_exceeded(
    stated, misfit, used, refitted, monkeypatch
):
    """Not where that noise is in use already, nor where it explains no residuals either."""
    after = diagnosed(True)
    monkeypatch.setattr(converge, "_diagnosed", lambda *_: after)
    monkeypatch.setattr(converge, "_beside", lambda *_: Some(name="found", differs=lambda _: False))
    monkeypatch.setattr(
        converge, "fit", lambda case, reduced, taken: Weighed(taken=(case, reduced, taken))
    )
    said = diagnosed(True, stated, misfit)
    end = converge._Converged("mistakes", Weighed(used=used), "there", said)
    found = converge._weighed(end, lambda work: work)
    assert found.right.taken == (("case", "reduced", True) if refitted else False)
    assert found.diagnosis is (after if refitted else said)


def test_noise_is_likely_by_its_shape_or_beside_a_stiffness_of_each_pose(monkeypatch):
    """The second is asked only if need be; the scatter of the scale is carried along."""
    seen = []

    def beside(right, said, loose=False):
        seen.append(loose)
        return Some(likely=said.likely)

    monkeypatch.setattr(converge, "_beside", beside)
    for own, other in ((True, False), (False, True), (False, False)):
        right, said = Some(shape=Some(likely=own)), Some(likely=other)
        assert converge._noise_likely(right, said) == (own or other)
    assert seen == [True, True]

    @dataclass(frozen=True)
    class Data:
        reading_std: np.ndarray

    data = converge._as_scattered(Data(np.array([2.0, 3.0])), Some(scatter=Some(scale=1.5)))
    assert data.reading_std.tolist() == [3.0, 4.5]


@pytest.mark.parametrize(
    ("whole", "taught", "inside", "carries"),
    [(0.0, [True, False], 0.9, True), (0.3, [True, False], 0.0, True),
     (0.3, [True, False], 0.2, False), (0.3, [True, True], 0.0, False)],
)  # fmt: skip
def test_a_law_carries_over_to_all_poses_or_to_those_between_others(
    whole, taught, inside, carries, monkeypatch
):
    """Where it was taught everywhere there is nothing else to ask."""
    mask = np.array(taught)
    monkeypatch.setattr(unlisted, "_without", lambda *_: "rest")
    monkeypatch.setattr(unlisted, "_taught", lambda *_: mask)

    def unproven(rest, rng, tests=None):
        assert rest == "rest"
        assert tests is None or tests is mask
        return whole if tests is None else inside

    found = Some(plain=Some(unproven=unproven), accepted=(0, 1, 2))
    assert unlisted._carried(None, found, 1, None) == carries
    laws = [Some(law=None), Some(law="a"), Some(law="b")]
    asked = []

    def carried(task, found, law, rng):
        asked.append(law)
        return law == 1

    monkeypatch.setattr(unlisted, "_carried", carried)
    assert not unlisted._carries(Some(suspects=laws), found, None)
    assert asked == [1, 2]
    assert unlisted._carries(Some(suspects=[laws[0], laws[1], laws[0]]), found, None)


def test_a_law_is_taught_at_poses_within_the_range_of_the_others(monkeypatch):
    """The lowest and the highest pose are not; a law without a variable is taught everywhere."""
    pose = np.repeat([0, 1, 2, 3], 2)
    v = np.array([5.0, 1.0, 9.0, 4.0])  # of each pull, one a pose
    monkeypatch.setattr(unlisted.unlisted, "follows", lambda law: law == "varies")
    monkeypatch.setattr(unlisted.unlisted, "variable", lambda law, loaded: v)
    monkeypatch.setattr(unlisted, "load", lambda *_: None)
    view = Some(pose=np.append(pose, -1), rows=RowIndex(pose, pose, pose, pose, pose))
    seen = Some(model=Some(cell=None, values=None))
    found = Some(plain=view, seen=seen)
    task = Some(suspects=[Some(law="varies"), Some(law="fixed"), Some(law=None)],
                data=Some(pulls=None))  # fmt: skip
    told = unlisted._taught(task, found, 0)
    assert told.tolist() == [True, True, False, False, False, False, True, True]
    for law in (1, 2):
        assert unlisted._taught(task, found, law).tolist() == [True] * 8


def test_a_law_is_told_from_its_extension_by_its_last_shape(monkeypatch):
    """Without it all else remains, and of an extension what it extends."""
    several = (suspect("a", FREE), suspect("b", FREE, FREE), suspect("c", FREE, FREE, FREE))
    view = made(np.random.default_rng(1), several, {}).view((0, 1, 2))
    found = Some(plain=view, accepted=(0, 1, 2))
    monkeypatch.setattr(
        unlisted, "extends", lambda one, other: (one.label, other.label) == ("c", "b")
    )
    rest = unlisted._without(Some(suspects=several), found, 1)
    assert rest.tolist() == view.columns([0, 2]).tolist()
    rest = unlisted._without(Some(suspects=several), found, 2)
    assert rest.tolist() == [*view.columns([0, 1]), *view.columns([2])[:2]]
