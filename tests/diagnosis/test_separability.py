"""Detectability and separability of causes: projections by numpy, powers by draws."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_campaign import FREE, left, made, suspect
from scipy import stats

from bench.league.visible import identifiable
from pipeline.answer import words
from pipeline.design.separability import separation, separation_found
from pipeline.diagnosis.blindspots import needed, smallest_visible, unnoticed, visible
from pipeline.diagnosis.diagnose import _unnoticed
from pipeline.diagnosis.facts import DETECTED, SEPARATED, Facts, UnloadedFacts
from pipeline.diagnosis.isolability import Twins
from pipeline.diagnosis.suspect_statistics import misfits, suspect_statistics
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load

SUSPECTS = (
    suspect("a", FREE, location="arm"),
    suspect("b", FREE, FREE, location="rail"),
    suspect("c", FREE, location="arm"),
    suspect("c", FREE, FREE, location="arm"),
    suspect("like a", FREE, location="wrist"),
)
NONE = Twins((), (), ())


@pytest.fixture(scope="module")
def truth():
    return made(np.random.default_rng(1), SUSPECTS, {1: [0.5, 0.2]}, alike={4: (0, 0.4)})


def own(truth, i):
    """Whitened columns of a cause in typical sizes."""
    return truth.columns(i)[:, 4:]


def beyond(truth, y, *causes):
    """Residuals of columns after springs, the shared error and some causes."""
    X = truth.columns(*causes)
    return y - X @ np.linalg.lstsq(X, y, rcond=None)[0]


def test_an_accepted_cause_is_compared_at_its_fitted_size(truth):
    """Residual of its fitted contribution when the other is fitted instead.

    For a possible replacement also the reverse, and the smaller counts. The prior of the sizes
    changes that by less than a thousandth.
    """
    y = truth.y
    found = separation_found(truth.view((1,)), (1,), range(5), [{"c": 2}])[0]

    def fitted(i):
        X = np.hstack([truth.columns(), own(truth, i)])
        return own(truth, i) @ np.linalg.lstsq(X, y, rcond=None)[0][-own(truth, i).shape[1] :]

    for b in (0, 2, 3, 4):
        form = 2 if SUSPECTS[b].label == "c" else b
        ways = ((1, form), (form, 1))
        here, there = (np.linalg.norm(beyond(truth, fitted(i), j)) for i, j in ways)
        left = min(here, there) if SUSPECTS[b].label == "c" else here
        assert found[b] == pytest.approx(left, rel=1e-3), b
    assert np.isnan(found[1])


@pytest.mark.parametrize("accepted", [(), (2,)])
def test_sigmas_between_causes_are_lengths_of_what_is_left(truth, accepted):
    """For each typical parameter of a, rms, with b fitted too; a alone on the diagonal."""
    view = truth.view(accepted)

    found = separation(view.M, view.base, view.at)
    batch = separation(np.stack([view.M, 4 * view.M]), view.base, view.at)

    for a in range(5):
        if a in accepted:
            continue

        def left(*others, a=a):
            each = [np.sum(beyond(truth, one, *others) ** 2) for one in own(truth, a).T]
            return np.sqrt(np.mean(each))

        assert found[a, a] == pytest.approx(left(*accepted))
        for b in set(range(5)) - {a, *accepted}:
            assert found[a, b] == pytest.approx(left(*accepted, b), rel=1e-6)
    np.testing.assert_allclose(batch[0], found, rtol=1e-9)
    np.testing.assert_allclose(batch[1], 2 * found, rtol=1e-9)


def test_a_cause_is_identifiable_from_where_its_least_form_is_apart_from_all(truth):
    """4.6 sigmas from any other, 5 from nothing; twins do not count."""
    view = truth.view()
    apart = separation(view.M, view.base, view.at)

    found = identifiable(view, NONE)
    with_twins = identifiable(view, Twins((), (("a", "like a"),), ()))

    def least(a, others):
        return min(min(SEPARATED / DETECTED * apart[a, a], *(apart[a, b] for b in others)), 1e9)

    assert found["a"] == pytest.approx(SEPARATED / least(0, [1, 2, 3, 4]))
    assert found["c"] == pytest.approx(SEPARATED / min(least(2, [0, 1, 4]), least(3, [0, 1, 4])))
    assert with_twins["a"] == pytest.approx(SEPARATED / least(0, [1, 2, 3]))
    assert with_twins["a"] < found["a"]
    assert set(found) == {"a", "b", "c", "like a"}


def test_what_no_size_separates_is_never_identifiable():
    """A column identical to another's: only rounding remains."""
    twins = made(np.random.default_rng(1), SUSPECTS, {}, alike={4: (0, 0.0)})

    found = identifiable(twins.view(), NONE)

    assert found["a"] > 1e6
    assert np.isfinite(found["b"])


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("p", [1e-2, 1e-5])
def test_the_noncentrality_is_found_in_four_of_five_cases(k, p):
    """By the noncentral chi-square of scipy."""
    assert stats.ncx2.sf(stats.chi2.isf(p, k), k, needed(k, p)) == pytest.approx(0.8, rel=1e-6)


def test_a_size_that_is_visible_is_found_in_four_of_five_draws(truth):
    """4000 draws of a cause of one parameter at that size, tested with known scatter."""
    view, p = truth.view(), 1e-3

    times = smallest_visible(view, view.base, p)

    z = beyond(truth, own(truth, 0)[:, 0])
    rng = np.random.default_rng(3)
    w = times[0] * np.linalg.norm(z) + rng.standard_normal(4000)
    assert np.mean(stats.chi2.sf(w**2, 1) < p) == pytest.approx(0.8, abs=0.025)
    for i in (1, 3):
        Z = beyond(truth, own(truth, i))
        least = needed(2, p) / (np.sum(Z**2) / 2)
        assert times[i] == pytest.approx(np.sqrt(least), rel=1e-6)


def test_what_the_base_has_or_hides_is_not_visible(truth):
    """An accepted one has no threshold; a combination of the base has no finite one."""
    view = truth.view((2,))
    times = smallest_visible(view, view.base, 1e-3)
    assert np.isnan(times[2])
    assert np.isfinite(times[[0, 1, 3, 4]]).all()

    hidden = made(np.random.default_rng(1), SUSPECTS, {}, alike={4: (0, 0.0)}).view((0,))
    assert smallest_visible(hidden, hidden.base, 1e-3)[4] == np.inf
    many = visible(np.stack([view.M, 9 * view.M]), view.base, view.at, 1e-3)
    np.testing.assert_allclose(many[1, [0, 1, 3, 4]], times[[0, 1, 3, 4]] / 3, rtol=1e-6)


ROBOT = load("kr500_rail")
CAUSES = {}
for one in catalogue(ROBOT):
    CAUSES.setdefault(one.label, one)


def spots(times, elsewhere=None, twins=NONE, forms=(), shown=False):
    """Blind spots, or what is `shown`, of causes detected from these multiples of typical size."""
    labels = [*times]
    effects = tuple(CAUSES[label] for label in labels)
    alone = made(
        np.random.default_rng(2),
        tuple(suspect(label, FREE) for label in (*labels, *forms)),
        {},
    )
    view = alone.view()
    size = smallest_visible(view, view.base, 1e-3)
    wanted = np.array([*times.values(), *(forms[f] for f in forms)]) if forms else np.array(
        [*times.values()]
    )  # fmt: skip
    scale = np.where(np.isinf(wanted), 0.0, size / np.where(np.isinf(wanted), 1, wanted))
    A = view.A.copy()
    A[:, view.first : -1] *= scale
    view = replace(view, A=A, M=A.T @ A)
    return {
        spot.effect.label: spot
        for spot in unnoticed(effects, view, view.base, 1e-3, twins, elsewhere or {})[shown]
    }


def test_causes_that_a_typical_size_would_not_show_are_blind_spots():
    """The best determined first; sizes in the unit of the first parameter."""
    found = spots({"rail_roll": 3.0, "joint_tilt:3": 0.9, "joint_tilt:4": np.inf, "compensator": 2})

    assert list(found) == ["joint_tilt:4", "rail_roll", "compensator"]
    typical = CAUSES["rail_roll"].parameters[0].typical
    assert found["rail_roll"].times == pytest.approx(3.0, rel=1e-6)
    assert found["rail_roll"].smallest_visible == pytest.approx(3 * typical, rel=1e-6)
    assert "0.33 of what" in found["rail_roll"].why
    assert found["joint_tilt:4"].smallest_visible is None
    assert "no pull" in found["joint_tilt:4"].why


def test_what_a_typical_size_would_have_shown_is_not_found():
    """With the size that would have been detected, by the best of both ways; twins never are."""
    times = {"rail_roll": 0.25, "joint_tilt:3": 3.0, "compensator": 2.0, "scale_gain": 0.1}
    twins = Twins(("scale_gain",), (), ())

    found = spots(times, {"compensator": 0.5}, twins, shown=True)

    assert {label: one.times for label, one in found.items()} == pytest.approx(
        {"rail_roll": 0.25, "compensator": 0.5}, rel=1e-6
    )
    said = words.not_found([*found.values()])
    assert "cases: roll of the carriage about the rail (2.5 nrad/(N·m)) and gravity comp" in said
    assert words.not_found([]) == ""


@pytest.mark.parametrize("weighs", [False, True])
def test_an_arm_that_sags_is_not_said_to_hide_its_sag(weighs):
    """Where links weigh in the estimated table, the sag is found, whatever a pull would show."""
    view = made(np.random.default_rng(2), (suspect("gravity_sag", FREE),), {}).view()
    A = view.A.copy()
    A[:, view.first : -1] *= 1e-6
    view = replace(view, A=A, M=A.T @ A)
    found = SimpleNamespace(view=view, first=view, threshold=SimpleNamespace(p=1e-3))
    cells = SimpleNamespace(zeros=SimpleNamespace(weighs=weighs))
    facts = Facts(unloaded=UnloadedFacts(1e-3, 1e-5, {"gravity_sag": 9.0}, cells=cells))

    blind, absent = _unnoticed((CAUSES["gravity_sag"],), found, facts, NONE)
    assert bool(blind) != weighs
    assert not absent
    # nor is an entry of a rough table, which is estimated, said not to be found
    shown = replace(facts.unloaded, visible={"joint_offset:3": 1.0}, rough=weighs)
    zero = (CAUSES["joint_offset:3"],)
    blind, absent = _unnoticed(zero, found, replace(facts, unloaded=shown), NONE)
    assert not blind
    assert bool(absent) != weighs


def test_what_shows_elsewhere_is_blind_only_where_it_shows_in_neither():
    """The smaller of both counts, and the smallest of several forms."""
    times = {"rail_roll": 3.0, "joint_tilt:3": 4.0, "compensator": 2.0}

    found = spots(times, {"rail_roll": 0.5, "joint_tilt:3": 1.5, "tool_flex": 7.0})

    assert {label: spot.times for label, spot in found.items()} == pytest.approx(
        {"joint_tilt:3": 1.5, "compensator": 2.0}
    )
    assert "rail_roll" not in spots(times, forms={"rail_roll": 0.8})


def test_twins_of_the_springs_are_blind_whatever_is_measured():
    """With what hides them: a common factor of all springs, or one joint's."""
    found = spots(
        {"scale_gain": 0.1, "rail_yaw": 0.1}, twins=Twins(("scale_gain", "rail_yaw"), (), ())
    )

    assert set(found) == {"scale_gain", "rail_yaw"}
    assert all(spot.smallest_visible is None for spot in found.values())
    assert "every stiffness alike" in found["scale_gain"].why
    assert "part of that joint" in found["rail_yaw"].why


def test_a_clue_is_the_likeliest_form_of_a_cause(truth):
    """Its p from two fits, its evidence, the part absorbed by springs, and its visible size."""
    view = truth.view()
    scores = view.beside(view.base)
    found = SimpleNamespace(first=view, scores=scores, threshold=SimpleNamespace(p=1e-3))

    got = {one.effect.label: one for one in suspect_statistics(found)}

    assert list(got) == ["a", "b", "c", "like a"]
    seen = smallest_visible(view, view.base, 1e-3)
    for label, forms in {"a": [0], "b": [1], "c": [2, 3]}.items():
        best = max(forms, key=lambda i: scores.log_evidence[i])
        one, k = got[label], len(SUSPECTS[best].parameters)
        assert one.effect is SUSPECTS[best]
        less, more = left(truth.columns(), truth.y), left(truth.columns(best), truth.y)
        F = (less - more) / k / (more / (69 - k))
        values = [getattr(one, name) for name in vars(one) if name != "effect"]
        Z, rest = own(truth, best), beyond(truth, own(truth, best))
        expected = [
            stats.f.sf(F, k, 69 - k),
            scores.log_evidence[best],
            1 - np.sum(rest**2) / np.sum(Z**2),
            min(seen[forms]),
        ]
        assert values == pytest.approx(expected, rel=1e-6)


def test_places_are_ordered_by_what_all_their_causes_together_explain(truth):
    """The F test of all causes of a place together."""
    got = misfits(truth.view())

    places = {"arm": (0, 2, 3), "rail": (1,), "wrist": (4,)}
    less = left(truth.columns(), truth.y)
    expected = {}
    for place, members in places.items():
        X = truth.columns(*members)
        k = X.shape[1] - 4
        more = left(X, truth.y)
        expected[place] = (
            1 - more / less,
            stats.f.sf((less - more) / k / (more / (69 - k)), k, 69 - k),
        )
    assert [next(iter(vars(one).values())) for one in got] == sorted(
        places, key=lambda p: expected[p][1]
    )
    for one in got:
        place, share, p = vars(one).values()
        assert (share, p) == pytest.approx(expected[place], rel=1e-6)


def test_a_column_that_the_base_hides_counts_in_the_size_but_not_in_the_test():
    """Two parameters, the second a spring's: lambda of one, root mean square over both."""
    causes = (suspect("a", FREE), suspect("half hidden", FREE, FREE))
    drawn = made(np.random.default_rng(1), causes, {})
    mine = np.column_stack([drawn.Z[1][:, 0], drawn.B[:, 0]])
    truth = replace(drawn, Z=(drawn.Z[0], mine))
    view, p = truth.view(), 1e-3

    times = smallest_visible(view, view.base, p)

    whole = left(truth.columns(), truth.columns(1)[:, -2])
    assert times[1] == pytest.approx(np.sqrt(2 * needed(1, p) / whole), rel=1e-6)
