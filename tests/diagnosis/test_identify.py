"""The search on linear campaigns: causes join, are exchanged, dropped; odds by quadrature."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from linear_campaign import (
    EACH,
    FREE,
    POSES,
    SPRINGS,
    STD_M,
    LinearTask,
    Seen,
    left,
    made,
    suspect,
    task_of,
)
from scipy import integrate, stats

from pipeline.diagnosis import cause_search
from pipeline.diagnosis.cause_search import by_label, search
from pipeline.machine.effects.nameless import NAMELESS
from pipeline.system.evidence import LEAST_EVIDENCE
from pipeline.system.linearised import CurrentModel

SUSPECTS = (
    suspect("a", FREE),
    suspect("b", FREE, FREE),
    suspect("c", FREE),
    suspect("c", FREE),
    suspect("like a", FREE),
    suspect("of one sign", (0.0, np.inf)),
)
DOF = 72 - 3


def found(truth, nameless=0, **more):
    case = task_of(truth, nameless, **more)
    return search(case, np.zeros(0), np.random.default_rng(1))


def evidence(truth, base, i):
    """Evidence of a cause of one parameter over the base alone, by numerical integration.

    p(z) normal with width w s about zero, p(s) ~ 1/s, all else flat; the mean over four widths.
    """
    X, y = truth.columns(*base), truth.y
    z = truth.columns(i)[:, 4]
    Q = np.linalg.qr(X)[0]
    y, z = y - Q @ (Q.T @ y), z - Q @ (Q.T @ z)
    n = len(y) - X.shape[1]
    best, rest = (z @ y) / (z @ z), y @ y

    def inner(s, size, w):
        misfit = np.sum((y - size * z) ** 2) - rest
        return np.exp(-0.5 * misfit / s**2) * stats.norm.pdf(size, 0, w * s)

    spread = 1 / np.sqrt(z @ z)
    s = np.sqrt(rest / n)
    grid = s * np.exp(np.linspace(-1.2, 0.9, 121))
    weight = np.exp(-n * np.log(grid / s) - 0.5 * rest / grid**2 + 0.5 * n)  # ds/s: uniform in log
    out = []
    for w in (0.4, 1.0, 2.5, 6.0):
        each = []
        for t in grid:
            sizes = best + spread * t * np.linspace(-9, 9, 241)
            misfit = (sizes**2 * (z @ z) - 2 * sizes * (z @ y)) / t**2
            shift = misfit.min()
            value = integrate.simpson(
                np.exp(-0.5 * (misfit - shift)) * stats.norm.pdf(sizes, 0, w * t), x=sizes
            )
            each.append(np.log(value) - 0.5 * shift)
        each = np.array(each) + np.log(weight)
        top = each.max()
        total = integrate.simpson(np.exp(each - top), x=np.log(grid))
        out.append(np.log(total) + top - np.log(integrate.simpson(weight, x=np.log(grid))))
    return np.log(np.mean(np.exp(out)))


def test_the_evidence_is_the_integral_over_sizes_and_scatter():
    """For two causes in addition to the springs, and to a third cause."""
    truth = made(np.random.default_rng(1), SUSPECTS, {0: [0.5]}, alike={4: (0, 0.5)})
    now = truth.view().beside(truth.view().base)

    for i in (0, 2, 4):
        assert now.log_evidence[i] == pytest.approx(evidence(truth, (), i), abs=0.02)
    rest = truth.view((2,))
    beside = rest.beside(rest.base)
    assert beside.log_evidence[0] == pytest.approx(evidence(truth, (2,), 0), abs=0.02)


class _Iterated(LinearTask):
    """A linear campaign that is estimated as any other, in several steps."""

    def model(self, accepted, start):
        return CurrentModel(None, np.zeros(SPRINGS + len(accepted)), SPRINGS, accepted)

    def only(self, accepted):
        return self

    def linearised(self, model, near=None):
        return Seen(model)

    def whitened(self, seen, doubt=()):
        return replace(self.truth.view(seen.model.accepted), model=seen.model)


@pytest.mark.parametrize("apart", [1.0, 1e-2, 1e-4, 1e-6, 0.0])
def test_causes_that_readings_hardly_distinguish_stay_near_their_typical_size(apart):
    """Their sum is estimated as by numpy; each of them would be thousands of typical sizes."""
    two = (SUSPECTS[0], SUSPECTS[2])
    truth = made(np.random.default_rng(8), two, {0: [0.5]}, alike={1: (0, apart)})
    task = task_of(truth)

    values = _Iterated(**vars(task)).estimated((0, 1), np.zeros(0)).values

    typical = np.array([p.typical for one in two for p in one.parameters])
    each = values[SPRINGS:] / typical
    if apart < 1:
        alone = np.linalg.lstsq(truth.columns(0), truth.y, rcond=None)[0][-1]
        assert each.sum() == pytest.approx(alone, abs=0.05)
    else:
        best = np.linalg.lstsq(truth.columns(0, 1), truth.y, rcond=None)[0]
        assert each == pytest.approx(best[-2:], rel=1e-6)
    assert np.abs(each).max() < 10


def test_nothing_is_accepted_where_nothing_acts():
    """And the odds of each, as if it were the only cause, sum to one."""
    got = found(made(np.random.default_rng(2), SUSPECTS, {}))

    assert got.accepted == ()
    assert not got.detected
    assert got.clean
    assert not got.explains
    assert got.rivals == ()
    assert got.p_values == ()
    assert sum(one.probability for one in got.single) == pytest.approx(1, abs=0.01)
    assert got.left == pytest.approx(got.scores.p().min())


def test_causes_that_act_join_one_by_one():
    """Two of six: each with its p in addition to the other, from two fits by numpy."""
    truth = made(np.random.default_rng(3), SUSPECTS, {1: [1.0, -0.7], 2: [0.8]})
    got = found(truth)

    assert sorted(got.accepted) == [1, 2]
    assert got.accepted[0] == 1  # the stronger first
    assert got.detected
    assert got.clean
    for place, (mine, rest) in enumerate(((1, 2), (2, 1))):
        k = len(SUSPECTS[mine].parameters)
        r = len(SUSPECTS[rest].parameters)
        less = left(truth.columns(rest), truth.y)
        more = left(truth.columns(rest, mine), truth.y)
        F = (less - more) / k / (more / (DOF - r - k))
        assert got.p_values[place] == pytest.approx(stats.f.sf(F, k, DOF - r - k), rel=1e-6)
        assert got.rivals[place][0].suspect == mine
        assert got.rivals[place][0].probability > 0.9


def test_a_mixture_that_joins_first_is_exchanged_for_what_it_is_made_of():
    """A column that is the sum of two planted ones explains most alone, but nothing finally."""
    suspects = (*SUSPECTS[:3], suspect("mix", FREE))
    truth = made(np.random.default_rng(4), suspects, {0: [2.5], 2: [2.5]}, mixed={3: (0, 2)})
    alone = truth.view().beside(truth.view().base).log_evidence

    got = found(truth)

    assert int(np.argmax(alone)) == 3
    assert sorted(got.accepted) == [0, 2]


def test_one_that_is_no_longer_needed_is_dropped():
    """With its components present, a mixture has no evidence; the worse of two is exchanged."""
    suspects = (*SUSPECTS[:3], suspect("mix", FREE))
    truth = made(np.random.default_rng(4), suspects, {0: [2.5], 2: [2.5]}, mixed={3: (0, 2)})
    case = task_of(truth)

    def better(*accepted, tried=frozenset()):
        return cause_search._better(case, truth.view(accepted), set(tried) | {frozenset(accepted)})

    assert better(3, 0, 2) == (0, 2)
    assert better(0, 3, 2) == (0, 2)
    assert better(0, 3) == (0, 2)
    assert better(3, 2) == (0, 2)
    assert better(0, 2) is None
    assert better(3, 0, 2, tried={frozenset({0, 2})}) != (0, 2)
    assert better(1) == (3,)
    assert better(1, tried={frozenset({3})}) in ((0,), (2,))


@dataclass(frozen=True, eq=False)
class _Bent(LinearTask):
    """Two causes that explain little once the campaign is linearised at what they are."""

    broken: frozenset = frozenset()

    def whitened(self, seen, doubt=(), in_each=True):
        if frozenset(seen.model.accepted) != self.broken:
            return super().whitened(seen)
        bent = self.truth.c + 30 * STD_M * np.random.default_rng(5).standard_normal(POSES * EACH)
        return replace(self.truth, c=bent).view(seen.model.accepted)


@pytest.mark.parametrize("broken", [frozenset(), frozenset({0, 2})])
def test_a_move_must_gain_where_it_is_linearised_anew(broken):
    """What it promised where it was chosen is not enough; other moves from there are tried."""
    suspects = (*SUSPECTS[:3], suspect("mix", FREE))
    truth = made(np.random.default_rng(4), suspects, {0: [2.5], 2: [2.5]}, mixed={3: (0, 2)})
    task = _Bent(**vars(task_of(truth)), broken=broken)

    end = cause_search._exchange(task, task.fitted((3,), np.zeros(0)), 1e-3).model.accepted

    assert {*end} == ({3} if broken else {0, 2})


MIXED = tuple(suspect(name, FREE) for name in ("a", "b", "c", "ab", "bc", "ac", "d", "e"))
PAIRS = {3: (0, 1), 4: (1, 2), 5: (0, 2)}


@pytest.mark.parametrize("seed", [100, 101, 103, 104, 116, 118])
def test_three_at_once_are_found_though_mixtures_of_them_come_first(seed):
    """Two causes, one of them a mixture of two true ones, are not the final result."""
    truth = made(np.random.default_rng(seed), MIXED, {k: [2.5] for k in range(3)}, mixed=PAIRS)
    alone = truth.view().beside(truth.view().base).log_evidence
    assert int(np.argmax(alone)) in PAIRS

    assert sorted(found(truth).accepted) == [0, 1, 2]


def test_two_take_the_places_of_two_in_one_move():
    """Neither may join alone: each is worse in the place of either mixture."""
    truth = made(np.random.default_rng(12), MIXED, {0: [3.0], 1: [3.0], 2: [3.0]}, mixed=PAIRS)
    case = task_of(truth)

    assert sorted(cause_search._better(case, truth.view((3, 4, 2)), {frozenset({2, 3, 4})})) == [
        0,
        1,
        2,
    ]
    assert cause_search._better(case, truth.view((0, 1, 2)), {frozenset({0, 1, 2})}) is None
    one = truth.view((0, 4))
    assert sorted(cause_search._better(case, one, {frozenset({0, 4})}, 1e-3)) == [0, 1, 2]
    assert cause_search._better(case, one, {frozenset({0, 4})}, 1e-30) != (0, 1, 2)


def test_one_that_stays_and_one_beside_it_are_no_exchange():
    """That is an addition, which is tried with the law of the first one uncertain."""
    truth = made(np.random.default_rng(12), SUSPECTS, {0: [3.0], 1: [3.0]})
    case, view = task_of(truth), truth.view((0,))
    beside = [move.into for move in cause_search._moves(case, view, (0,), 2)]

    assert view.beside(view.base).log_evidence[1] > 10
    assert any(len(into) == 2 for into in beside)
    assert not any(0 in into for into in beside if len(into) == 2)


def test_where_three_leave_something_a_fourth_shows_which_was_a_mixture():
    """Four join, and the one made redundant by the others is dropped."""
    truth = made(np.random.default_rng(13), MIXED, {0: [3.0], 1: [3.0], 6: [2.0]}, mixed=PAIRS)
    case = task_of(truth)

    left = cause_search._dropped(case, case.fitted((3, 0, 1, 6), np.zeros(0)))

    assert sorted(left.model.accepted) == [0, 1, 6]


def test_three_that_leave_something_make_room_for_the_parts_of_a_mixture():
    """A mixture, a true one and a false one: the maximum number, but wrong ones."""
    truth = made(np.random.default_rng(13), MIXED, {0: [3.0], 1: [3.0], 6: [2.0]}, mixed=PAIRS)
    case, accepted = task_of(truth), (3, 6, 7)
    first = case.whitened(case.fitted((), np.zeros(0)))
    limit = cause_search.threshold(first, first.base, DOF, np.random.default_rng(1))
    end = cause_search._stand(case, case.fitted(accepted, np.zeros(0)), accepted)
    assert cause_search._open(end, limit)

    better = cause_search._fewer(case, end, limit, {})

    assert sorted(better.seen.model.accepted) == [0, 1, 6]
    assert cause_search._worth(case, better.plain) > cause_search._worth(case, end.plain)


def test_the_same_is_found_in_whatever_order_poses_and_causes_stand():
    """With the rows of other poses first, and the catalogue reversed."""
    truth = made(np.random.default_rng(116), MIXED, {k: [2.5] for k in range(3)}, mixed=PAIRS)
    rows = np.arange(len(truth.c)).reshape(8, -1)[::-1].ravel()
    turned = replace(
        truth,
        suspects=truth.suspects[::-1],
        Z=tuple(part[rows] for part in truth.Z[::-1]),
        B=truth.B[rows],
        c=truth.c[rows],
        W=truth.W[np.ix_(rows, rows)],
        shared=truth.shared[rows],
    )

    one, other = found(truth), found(turned)

    assert {MIXED[i].label for i in one.accepted} == {"a", "b", "c"}
    assert {MIXED[::-1][i].label for i in other.accepted} == {"a", "b", "c"}
    mine = cause_search._chained(task_of(truth), truth.view((0, 1, 2)), (), (0, 1, 2))
    assert mine == pytest.approx(
        cause_search._chained(task_of(turned), turned.view((7, 5, 6)), (), (7, 5, 6)), rel=1e-9
    )


def test_of_two_alike_causes_the_likelier_leads_and_twins_stay():
    """Log evidence must be larger by a tenth to take a place."""
    twins = made(np.random.default_rng(5), SUSPECTS, {0: [2.0]}, alike={4: (0, 1e-9)})
    view = twins.view((4,))

    assert cause_search._better(task_of(twins), view, {frozenset({4})}) is None
    alike = made(np.random.default_rng(5), SUSPECTS, {0: [4.0]}, alike={4: (0, 0.5)})
    assert cause_search._better(task_of(alike), alike.view((4,)), {frozenset({4})}) == (0,)


def test_the_odds_of_rivals_are_those_of_bayes():
    """All causes have equal prior probability, shared by the two forms of one."""
    suspects = tuple(SUSPECTS[i] for i in (0, 2, 3, 4))
    truth = made(np.random.default_rng(6), suspects, {0: [0.7]}, alike={3: (0, 0.6), 1: (0, 1.0)})
    now = truth.view().beside(truth.view().base)
    each = np.exp([evidence(truth, (), i) for i in range(4)])
    causes = np.array([each[0], each[1:3].mean(), each[3]])
    expected = dict(zip(("a", "c", "like a"), causes / causes.sum(), strict=True))

    got = cause_search._odds(task_of(truth), now, (), 0.0)

    assert {one.label: one.probability for one in got} == pytest.approx(expected, rel=0.03)
    order = [one.probability for one in got]
    assert order == sorted(order, reverse=True)
    of_c = next(one for one in got if one.label == "c")
    assert dict(of_c.forms) == pytest.approx(
        {i: each[i] / each[1:3].sum() for i in (1, 2)}, rel=0.03
    )
    assert of_c.suspect == 1 + int(np.argmax(each[1:3]))
    few = cause_search._odds(task_of(truth), now, (3,), 0.0)
    assert "like a" not in {one.label for one in few}
    assert sum(one.probability for one in few) == pytest.approx(1.0)
    least = sorted(expected.values())[0]
    assert len(cause_search._odds(task_of(truth), now, (), 1.01 * least)) == 2


def test_a_size_that_physics_forbids_is_no_evidence():
    """A negative compliance has no evidence, however well it fits."""
    truth = made(np.random.default_rng(7), SUSPECTS, {5: [-3.0]})
    got = found(truth)

    assert 5 not in got.accepted
    assert got.scores.p()[5] < 1e-9
    assert got.scores.log_evidence[5] < 0
    right = found(made(np.random.default_rng(7), SUSPECTS, {5: [3.0]}))
    assert right.accepted == (5,)
    assert right.refused == ()


@pytest.mark.parametrize(("most", "taken"), [(2.0, False), (2.9, True), (np.inf, True)])
def test_a_size_that_the_unloaded_reflectors_refute_is_refused(most, taken):
    """Three typical sizes where two would have been visible; within two sigma it is accepted."""
    truth = made(np.random.default_rng(8), SUSPECTS, {0: [3.0]})

    got = found(truth, refuted={"a": most})

    assert (got.accepted == (0,)) is taken
    assert ("a" in got.refused) is not taken
    minus = found(made(np.random.default_rng(8), SUSPECTS, {0: [-3.0]}), refuted={"a": most})
    assert (minus.accepted == (0,)) is taken


def test_the_worth_of_causes_does_not_depend_on_what_else_was_linearised():
    """It is the whole evidence: that of the springs, and of each cause beside those before."""
    truth = made(np.random.default_rng(4), SUSPECTS, {0: [2.0]})
    case = task_of(truth)

    two, one = (cause_search._worth(case, truth.view(of)) for of in ((0, 2), (0,)))

    more = truth.view((0,)).beside(truth.view((0,)).base).log_evidence[2]
    assert two - one == pytest.approx(more - LEAST_EVIDENCE)
    less = truth.view().beside(truth.view().base)
    assert one == pytest.approx(
        less.log_evidence[0] - LEAST_EVIDENCE - 0.5 * less.dof * np.log(less.rest)
    )


def test_bounds_have_two_sigma_and_a_third_of_slack():
    """An estimate beyond its bound by less is attributed to chance."""
    truth = made(np.random.default_rng(9), SUSPECTS, {0: [1.0]})
    view = truth.view()
    now = view.beside(view.base)
    X = truth.columns(0)
    x, rest, *_ = np.linalg.lstsq(X, truth.y, rcond=None)
    std = np.sqrt(np.linalg.inv(X.T @ X)[4, 4])
    assert rest > 0
    for beyond, said in ((-0.02, True), (0.02, False)):
        most = x[4] - 2 * std - 0.3 - beyond
        case = task_of(truth, refuted={"a": most})
        assert cause_search._possible(case, now, 0) is said


def test_no_more_than_three_join_and_one_cause_joins_in_one_form():
    """Five planted, two of them forms of one cause."""
    suspects = (*SUSPECTS[:4], suspect("d", FREE))
    truth = made(
        np.random.default_rng(10), suspects, {0: [3.0], 1: [3.0, 3.0], 2: [4.0], 3: [3.0], 4: [2.0]}
    )

    got = found(truth)

    assert len(got.accepted) == 3
    assert len({suspects[i].label for i in got.accepted}) == 3
    assert not got.clean


def test_what_has_no_name_competes_with_the_causes():
    """Its odds against the accepted one, or the two that it imitates, by Bayes."""
    suspects = (*SUSPECTS[:1], SUSPECTS[2], suspect("d", FREE), suspect("nameless", FREE))
    truth = made(np.random.default_rng(11), suspects, {0: [1.0], 2: [1.0]}, mixed={3: (0, 2)})
    case = task_of(truth, nameless=1)
    got = found(truth, nameless=1)
    assert sorted(got.accepted) == [0, 2]

    def odds(strange, named):
        return NAMELESS * strange / (NAMELESS * strange + named)

    one = cause_search._instead(case, truth.view((0, 2)), (0,))
    named = np.exp([evidence(truth, (2,), i) for i in (0, 1)])
    assert one.probability == pytest.approx(
        odds(np.exp(evidence(truth, (2,), 3)), named.sum()), rel=0.05
    )
    assert one.suspect == 3
    both = cause_search._instead(case, truth.view((0, 2)), (0, 1))
    named = np.exp(evidence(truth, (), 0) + evidence(truth, (0,), 2))
    assert both.probability == pytest.approx(odds(np.exp(evidence(truth, (), 3)), named), rel=0.05)
    assert both.places == (0, 1)
    worst = cause_search._strange(case, truth.view((0, 2)))
    assert [s.probability for s in worst] == [
        max(both.probability, cause_search._instead(case, truth.view((0, 2)), (k,)).probability)
        for k in (0, 1)
    ]
    assert cause_search._strange(replace(case, nameless=()), truth.view((0, 2))) == ()


def test_forms_of_a_cause_are_kept_together():
    """In the order of the catalogue."""
    assert by_label(SUSPECTS) == {
        "a": [0], "b": [1], "c": [2, 3], "like a": [4], "of one sign": [5],
    }  # fmt: skip
