"""What is stated if it is uncertain which causes are true."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse
from scipy import optimize, stats

from pipeline.answer.stiffness import stiffness_entries
from pipeline.diagnosis import average as average_module
from pipeline.diagnosis.average import (
    LEAST_PROBABILITY,
    POSSIBLE,
    Hypothesis,
    average,
    dependences,
    each_way,
    size,
    springs,
    weighed,
)
from pipeline.diagnosis.cause_search import NamelessReplacement, Replacement
from pipeline.diagnosis.hypotheses import _likely
from pipeline.machine.cell import Tool, baseline, paper_cell
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import configure, load
from pipeline.system.estimate import identifiable, solve
from pipeline.system.system import Errors, Estimate, Goodness, RowIndex, System

KR500 = load("kr500_rail")
X = KR500.nominal_compliance
BASELINE = tuple(p for effect in baseline(KR500) for p in effect.parameters)
EFFECTS = {effect.label: effect for effect in catalogue(KR500)}
CELL = SimpleNamespace(robot=KR500)


def hypothesis(weight, factor=1.0, relative=0.01, lost=None, instead=None, cov=None):
    """Joint springs of `factor` times nominal size with a relative uncertainty, and one cause."""
    effect = EFFECTS[instead or "joint_tilt:5"]
    parameters = (*BASELINE, *effect.parameters)
    value = np.append(factor * X, np.zeros(len(effect.parameters)))
    own = np.diag((relative * X) ** 2) if cov is None else cov
    typical = np.array([p.typical for p in parameters])
    whole = np.eye(len(value)) * 1e-30
    whole[:7, :7] = own
    if lost is not None:
        whole[lost, lost] = np.inf
    k = len(value)
    rows = RowIndex(
        *[np.arange(3)] * 2, np.array(["P1"] * 3, object), np.arange(3), np.zeros(3, int)
    )
    errors = Errors(
        scipy.sparse.csr_array(np.eye(3)), np.array(["tracker"] * 3, object), [False] * 3
    )
    system = System(parameters, rows, np.ones((3, k)), np.zeros(3), errors, True)
    known = identifiable(typical, value, np.sqrt(np.diag(whole)))
    rest = (np.zeros(3), Goodness(1.0, 1, 0.5), "stated", 1e-5, 1.96)
    estimate = Estimate(parameters, value, whole, known, *rest)
    told = (("joint_tilt:5", instead),) if instead else ()
    return Hypothesis(weight, (effect,), CELL, system, estimate, told)


def correlated(rng, relative):
    """A full covariance of the springs."""
    half = relative * X[:, None] * (0.6 * rng.standard_normal((7, 7)) + np.eye(7))
    return half @ half.T


def test_one_hypothesis_is_its_own_estimate():
    """Without alternatives, value, covariance and interval are those of the one model."""
    one = hypothesis(1.0, cov=correlated(np.random.default_rng(1), 0.01))

    found = springs([one])

    np.testing.assert_array_equal(found.value, one.estimate.value[:7])
    np.testing.assert_array_equal(found.cov, one.estimate.cov[:7, :7])
    np.testing.assert_allclose(found.high, found.value + 1.96 * found.std, rtol=1e-14)


def test_value_and_covariance_are_those_of_draws():
    """Draw a hypothesis by its weight, then its springs: mean and covariance are as stated."""
    rng = np.random.default_rng(2)
    several = [
        hypothesis(w, f, cov=correlated(rng, 0.02), instead=name)
        for w, f, name in ((0.6, 1.0, None), (0.3, 1.1, "joint_tilt:6"), (0.1, 0.9, "tool_flex"))
    ]
    found = springs(several)

    which = rng.choice(3, 200_000, p=[0.6, 0.3, 0.1])
    drawn = np.empty((len(which), 7))
    for k, one in enumerate(several):
        mine = which == k
        drawn[mine] = rng.multivariate_normal(
            one.estimate.value[:7] / X, one.estimate.cov[:7, :7] / np.outer(X, X), mine.sum()
        )
    assert found.value / X == pytest.approx(drawn.mean(axis=0), abs=1e-3)
    assert found.cov / np.outer(X, X) == pytest.approx(np.cov(drawn.T), rel=0.05, abs=1e-4)


def test_an_unlikely_hypothesis_widens_the_interval_as_draws_do():
    """Below 5 % each, the 95 % interval is that of the draws if wider than the first's."""
    rng = np.random.default_rng(3)
    several = [
        hypothesis(0.92, 1.0),
        hypothesis(0.04, 1.2, instead="joint_tilt:6"),
        hypothesis(0.04, 1.3, instead="tool_flex"),
    ]
    found = springs(several)

    which = rng.choice(3, 400_000, p=[0.92, 0.04, 0.04])
    drawn = np.array([1.0, 1.2, 1.3])[which] + 0.01 * rng.standard_normal(len(which))
    low, high = np.quantile(drawn, [0.025, 0.975])
    assert high > 1.1
    assert found.high / X == pytest.approx(high, abs=2e-3)
    assert found.low / X == pytest.approx(min(low, 1 - 0.0196), abs=1e-3)


def sized(weight, value, std, label):
    """A hypothesis whose cause has this value of its first parameter [rad/(N m)]."""
    one = hypothesis(weight, instead=label)
    cov, x = one.estimate.cov.copy(), one.estimate.value.copy()
    x[7], cov[7, 7] = value, std**2
    return replace(one, estimate=replace(one.estimate, value=x, cov=cov))


def test_the_size_of_a_cause_is_that_of_draws_from_the_hypotheses_that_hold_it():
    """Weights conditional on the cause; a hypothesis with another cause does not contribute."""
    rng = np.random.default_rng(4)
    several = [
        sized(0.5, 3.0e-7, 2e-8, "joint_tilt:5"),
        sized(0.3, 9.0e-7, 1e-8, "joint_tilt:6"),
        sized(0.2, 4.0e-7, 1e-8, "joint_tilt:5"),
    ]

    value, std, (low, high) = size(several, EFFECTS["joint_tilt:5"], 0)

    which = rng.random(400_000) < 0.2 / 0.7
    z = rng.standard_normal(len(which))
    drawn = np.where(which, 4.0e-7 + 1e-8 * z, 3.0e-7 + 2e-8 * z)
    assert value == pytest.approx(drawn.mean(), rel=2e-3)
    assert std == pytest.approx(drawn.std(), rel=5e-3)
    assert low == pytest.approx(3.0e-7 - 1.96 * 2e-8, rel=2e-3)
    assert high == pytest.approx(4.0e-7 + 1.96 * 1e-8, rel=2e-3)


def test_every_interval_holds_whichever_likely_hypothesis_is_true():
    """Two rivals: the interval extends from the lower end of one to the upper end of the other."""
    rivals = [hypothesis(0.9, 1.0), hypothesis(0.1, 1.3, instead="joint_tilt:6")]

    found = springs(rivals)

    for one in rivals:
        value, std = one.estimate.value[:7], one.estimate.std[:7]
        assert (found.low <= value - 1.95 * std).all()
        assert (found.high >= value + 1.95 * std).all()


def test_what_a_likely_hypothesis_leaves_undetermined_is_undetermined():
    """Joint 6 is undetermined with a rival of 30 %: it has no value; the others keep theirs."""
    several = weighed([hypothesis(0.7), hypothesis(0.3, lost=5, instead="joint_tilt:6")])

    found = springs(several)

    assert np.isinf(found.std[5])
    assert not found.identifiable[5]
    assert found.identifiable[[0, 1, 2, 3, 4, 6]].all()
    assert [(d.spring, d.rival, d.lost) for d in dependences(several)] == [
        (5, "joint_tilt:6", True)
    ]


def test_an_unlikely_hypothesis_takes_no_stiffness_away():
    """Below 5 % a hypothesis that loses a joint is left out, and below 1 % any is."""
    first, loses = hypothesis(0.9), hypothesis(0.9 * POSSIBLE, lost=5, instead="joint_tilt:6")
    moves = hypothesis(2 * LEAST_PROBABILITY, 1.1, instead="tool_flex")
    rare = hypothesis(0.5 * LEAST_PROBABILITY, 1.1, instead="joint_tilt:7")

    kept = weighed([first, loses, moves, rare])

    assert [one.instead for one in kept] == [(), (("joint_tilt:5", "tool_flex"),)]
    assert sum(one.weight for one in kept) == pytest.approx(1)
    assert np.isfinite(springs(kept).std).all()


def test_many_unlikely_hypotheses_together_take_a_stiffness_away():
    """Five of 4 % each that leave a joint undetermined: one may be ignored, 20 % may not."""
    others = [hypothesis(0.04, lost=5, instead=f"joint_tilt:{j}") for j in (2, 3, 4, 6, 7)]

    kept = weighed([hypothesis(0.8), *others])

    assert len(kept) == 5
    assert not springs(kept).identifiable[5]
    assert {d.lost for d in dependences(kept)} == {True}


def test_a_hypothesis_that_hardly_determines_a_stiffness_loses_it():
    """A finite uncertainty of several times the value does not determine it."""
    vague = hypothesis(0.03, relative=5.0, instead="joint_tilt:6")

    assert weighed([hypothesis(0.97), vague])[0].weight == 1.0
    likely = weighed([hypothesis(0.7), replace(vague, weight=0.3)])
    assert not springs(likely).identifiable.any()
    assert {d.rival for d in dependences(likely) if d.lost} == {"joint_tilt:6"}


def test_a_stiffness_that_the_identified_cause_loses_is_told_the_other_way_round():
    """Joint 6 is undetermined with the identified cause, but not with its rival."""
    kept = weighed([hypothesis(0.5, lost=5), hypothesis(0.5, instead="joint_tilt:6")])

    (told,) = [d for d in dependences(kept) if d.spring == 5]
    assert (told.cause, told.rival, told.lost) == ("joint_tilt:6", "joint_tilt:5", True)


def measured(weight, factor, instead=None, ratio=1.0):
    """Springs of `factor` times nominal and one cause, estimated from readings of two sources."""
    effect = EFFECTS[instead or "joint_tilt:5"]
    parameters = (*BASELINE, *effect.parameters)
    typical = np.array([p.typical for p in parameters])
    rng = np.random.default_rng(5)
    B = 1e-3 * rng.standard_normal((60, len(typical))) / typical
    value = np.append(factor * X, np.zeros(len(effect.parameters)))
    pose = np.repeat(np.arange(20), 3)
    G = scipy.sparse.csr_array(np.hstack([1e-5 * np.eye(60), 1e-5 * rng.standard_normal((60, 1))]))
    source = np.array(["tracker"] * 60 + ["force_gain"], object)
    errors = Errors(G, source, source == "force_gain")
    rows = RowIndex(pose, pose, np.array(["P1"] * 60, object), np.tile(np.arange(3), 20), pose)
    system = System(parameters, rows, B, B @ value, errors, True)
    told = (("joint_tilt:5", instead),) if instead else ()
    return Hypothesis(weight, (effect,), CELL, system, solve(system, value), told, ratio)


def test_the_budget_of_an_average_adds_up_and_says_what_the_decision_costs():
    """The shares of the sources and that of the undecided cause sum to the variance."""
    apart = [measured(0.5, 1.0), measured(0.5, 1.1, "joint_tilt:6")]

    entries = stiffness_entries(CELL, apart)

    for entry in entries:
        shares = {part.source: part.share for part in entry.budget}
        assert set(shares) == {"tracker", "force_gain", "which_cause"}
        assert sum(shares.values()) == pytest.approx(1)
        off = 0.05 / (1.05 * entry.relative_std)  # half the distance, in standard uncertainties
        assert shares["which_cause"] == pytest.approx(off**2, rel=1e-6)
        assert all(label in entry.finding for label in ("joint_tilt:5", "joint_tilt:6"))


def test_what_is_left_over_the_scatter_widens_every_source():
    """Residuals of 1.5 times the scatter: each part of the budget is 1.5 times as large."""
    plain, rough = (measured(1.0, 1.0, ratio=r) for r in (1.0, 1.5))
    wider = replace(rough.estimate, cov=rough.estimate.cov * 1.5**2)

    (one, *_), (other, *_) = (
        stiffness_entries(CELL, [h]) for h in (plain, replace(rough, estimate=wider))
    )

    assert other.std == pytest.approx(1.5 * one.std)
    for a, b in zip(one.budget, other.budget, strict=True):
        assert b.share == pytest.approx(a.share)
        assert b.std == pytest.approx(1.5 * a.std)


def test_one_stranger_for_two_causes_is_one_hypothesis():
    """An unnamed cause in place of both counts once; no cause is in two places."""
    label = {0: "A", 1: "B", 2: "C"}
    case = SimpleNamespace(suspects=[SimpleNamespace(label=label[i], law=None) for i in range(3)])

    def rival(i, probability):
        return Replacement(label[i], i, probability, ((i, 1.0),))

    both = NamelessReplacement(0.4, 3, (0, 1))
    found = SimpleNamespace(
        accepted=(0, 1),
        rivals=((rival(0, 0.6), rival(2, 0.4)), (rival(1, 0.7), rival(2, 0.3))),
        strange=(both, both),
    )

    sets = {one.suspects: one.weight for one in _likely(case, found)}

    assert sets == pytest.approx({(0, 1): 0.252, (3,): 0.4, (2, 1): 0.168, (0, 2): 0.108})


def test_the_laws_of_a_cause_share_its_probability():
    """A cause with two laws: the accepted one and the other, each with its share."""
    case = SimpleNamespace(suspects=[SimpleNamespace(label="A", law=None)] * 2)
    found = SimpleNamespace(
        accepted=(0,), rivals=((Replacement("A", 0, 1.0, ((0, 0.8), (1, 0.2))),),), strange=()
    )

    first, second = _likely(case, found)

    assert (first.suspects, second.suspects) == ((0,), (1,))
    assert [first.weight, second.weight] == pytest.approx([0.8, 0.2])
    assert second.instead == ()  # another law, not another cause


def moments(weights, values, covs):
    """Mean and covariance of a mixture from its first two moments, entry by entry."""
    n = values.shape[1]
    mean = np.array([sum(w * x[i] for w, x in zip(weights, values, strict=True)) for i in range(n)])
    second = sum(
        w * (C + np.outer(x, x)) for w, x, C in zip(weights, values, covs, strict=True)
    )  # fmt: skip
    return mean, second - np.outer(mean, mean)


@pytest.mark.parametrize("seed", range(5))
def test_the_average_is_the_mixture_of_its_moments(seed):
    """E[x x'] - E[x] E[x]' and E[x] of two to six components, with correlations."""
    rng = np.random.default_rng(seed)
    h = 2 + seed
    weights, values = rng.dirichlet(np.ones(h)), rng.standard_normal((h, 3))
    half = rng.standard_normal((h, 3, 3))
    covs = half @ half.swapaxes(1, 2)

    mean, cov = average(weights, values, covs)

    expected = moments(weights, values, covs)
    assert mean == pytest.approx(expected[0])
    assert cov == pytest.approx(expected[1])
    order = rng.permutation(h)
    again = average(weights[order], values[order], covs[order])
    assert again[0] == pytest.approx(mean)
    assert again[1] == pytest.approx(cov)


def test_a_component_that_leaves_an_entry_undetermined_has_no_say_in_it():
    """Its value is ignored: the mean is that of the others by weight, with infinite variance."""
    rng = np.random.default_rng(1)
    weights, values = np.array([0.5, 0.2, 0.3]), rng.standard_normal((3, 3))
    covs = np.stack([0.1 * np.eye(3)] * 3)
    covs[1, 1, 1] = covs[0, 2, 2] = covs[1, 2, 2] = covs[2, 2, 2] = np.inf
    wild = values.copy()
    wild[1, 1] = 1e6

    (mean, cov), (other, wider) = (average(weights, x, covs) for x in (values, wild))

    assert mean[1] == other[1] == pytest.approx((0.5 * values[0, 1] + 0.3 * values[2, 1]) / 0.8)
    assert mean[[0, 2]] == pytest.approx(weights @ values[:, [0, 2]])
    assert np.isinf(np.diag(cov)).tolist() == np.isinf(np.diag(wider)).tolist()
    assert np.isinf(np.diag(cov)).tolist() == [False, True, True]
    assert cov[0, 0] == pytest.approx(
        moments(weights, values[:, :1], np.full((3, 1, 1), 0.1))[1][0, 0]
    )


def test_what_only_an_impossible_one_determines_is_its_value_and_unknown():
    """A weight of zero divides nothing: the only value is used, with infinite variance."""
    covs = np.array([np.eye(2), np.diag([1.0, np.inf])])

    mean, cov = average([0.0, 1.0], np.array([[1.0, 2.0], [3.0, 9.0]]), covs)

    np.testing.assert_allclose(mean, [3.0, 2.0])
    assert np.isinf(np.diag(cov)).tolist() == [False, True]


def low_and_high(several):
    """Ends of the interval of joint 1 relative to its nominal compliance."""
    found = springs(several)
    return found.low[0] / X[0], found.high[0] / X[0]


def test_both_ends_of_the_interval_are_quantiles_of_the_mixture():
    """More compliant on one side and stiffer on the other, 4 % each: each end cuts off 2.5 %."""
    parts = [(0.92, 1.0), (0.04, 0.7), (0.04, 1.3)]
    several = [
        hypothesis(w, f, instead=name)
        for (w, f), name in zip(parts, (None, "joint_tilt:6", "tool_flex"), strict=True)
    ]

    def share(x):
        """Fraction of the mixture below x; each part is known to 1 % of nominal."""
        return sum(w * stats.norm.cdf(x, f, 0.01) for w, f in parts)

    ends = [optimize.brentq(lambda x, p=p: share(x) - p, 0.5, 1.5) for p in (0.025, 0.975)]

    assert ends[0] < 0.75
    assert ends[1] > 1.25
    assert low_and_high(several) == pytest.approx(ends, abs=1e-6)


def test_few_degrees_of_freedom_widen_their_own_hypothesis():
    """Student's quantile for 3 degrees of freedom widens that part to its own interval."""
    first, other = hypothesis(0.97, 1.0), hypothesis(0.03, 1.3, instead="tool_flex")
    t = float(stats.t.ppf(0.975, 3))
    other = replace(other, estimate=replace(other.estimate, quantile=t))
    wide = 0.01 * t / stats.norm.ppf(0.975)

    def share(x):
        return 0.97 * stats.norm.cdf(x, 1.0, 0.01 * 1.96 / stats.norm.ppf(0.975)) + (
            0.03 * stats.norm.cdf(x, 1.3, wide)
        )

    end = optimize.brentq(lambda x: share(x) - 0.975, 0.9, 1.6)
    assert low_and_high([first, other])[1] == pytest.approx(end, abs=1e-6)
    likely = [replace(first, weight=0.9), replace(other, weight=0.1)]
    assert low_and_high(likely)[1] >= 1.3 + t * 0.01 - 1e-12
    alone = replace(first, estimate=replace(first.estimate, quantile=t))
    assert low_and_high([alone]) == pytest.approx((1 - 0.01 * t, 1 + 0.01 * t))


def test_an_interval_holds_what_is_just_likely_and_not_what_is_not():
    """Above a limit of 5 %, the whole interval of the hypothesis is included."""
    for weight, held in ((1.2 * POSSIBLE, True), (0.4 * POSSIBLE, False)):
        pair = [hypothesis(1 - weight, 1.0), hypothesis(weight, 1.3, instead="tool_flex")]
        assert bool(low_and_high(pair)[1] >= 1.3 + 0.0195) is held


def test_what_is_lost_has_no_interval():
    """With a likely rival that loses joint 6, joint 6 has no interval; the others have one."""
    pair = [hypothesis(0.6), hypothesis(0.4, 1.1, lost=5, instead="tool_flex")]
    found = springs(pair)

    assert np.isinf([found.low[5], found.high[5]]).all()
    kept = np.arange(7) != 5
    assert np.isfinite(found.low[kept]).all()
    assert found.value[5] == pytest.approx(X[5], rel=1e-6, abs=0)
    assert found.value[kept] == pytest.approx(1.04 * X[kept], rel=1e-6, abs=0)
    rare = springs([hypothesis(0.96), hypothesis(0.04, 1.5, lost=5, instead="tool_flex")])
    assert rare.high[5] == pytest.approx(1.0196 * X[5], rel=1e-3, abs=0)
    assert rare.high[4] > 1.4 * X[4]


def test_a_stiffness_that_no_single_hypothesis_doubts_may_be_doubtful_together():
    """Each of two knows it to 1 %, at values in a ratio of three: the mixture does not."""
    pair = [hypothesis(0.5, 0.2), hypothesis(0.5, 3.4, instead="tool_flex")]

    assert all(one.estimate.identifiable[:7].all() for one in pair)
    assert not springs(pair).identifiable.any()
    assert springs([hypothesis(0.5, 1.0), hypothesis(0.5, 1.1)]).identifiable.all()
    vague = hypothesis(0.1, relative=0.6, instead="tool_flex")
    assert not springs([hypothesis(0.9), vague]).identifiable.any()


@pytest.mark.parametrize(
    ("factor", "relative", "weight", "told"),
    [
        (1.006, 0.01, 0.3, True),
        (1.004, 0.01, 0.3, False),
        (0.994, 0.01, 0.3, True),
        (1.0, 0.0151, 0.3, True),
        (1.0, 0.0149, 0.3, False),
        (1.1, 0.01, 0.9 * POSSIBLE, False),
    ],
    ids=["softer", "the same", "stiffer", "less sure", "as sure", "unlikely"],
)
def test_half_a_standard_uncertainty_is_a_dependence(factor, relative, weight, told):
    """If shifted by more, or half again as uncertain, a spring depends on the cause."""
    pair = [
        hypothesis(1 - weight),
        hypothesis(weight, factor, relative=relative, instead="joint_tilt:6"),
    ]

    found = dependences(pair)

    assert [one.spring for one in found] == (list(range(7)) if told else [])
    assert all((d.cause, d.rival, d.lost) == ("joint_tilt:5", "joint_tilt:6", False) for d in found)


def test_weights_that_are_kept_stay_in_proportion():
    """Weights of omitted ones go to the others; the first stays even with weight zero."""
    rare = hypothesis(0.5 * LEAST_PROBABILITY, instead="joint_tilt:7")
    kept = weighed([hypothesis(0.2), hypothesis(0.6, instead="tool_flex"), rare])

    assert [one.weight for one in kept] == pytest.approx([0.25, 0.75])
    assert weighed([hypothesis(0.0)])[0].weight == 1.0
    order = weighed([hypothesis(0.1), hypothesis(0.3), hypothesis(0.6)])
    assert [one.weight for one in order] == pytest.approx([0.1, 0.6, 0.3])


# --- joints with a compliance for each sign of the torque -----------------------------------------

SIDED = EFFECTS["joint_asymmetry:3"]
TOOL = Tool(np.array([0.2, 0.1, 0.3]), np.array(["P1"], object), np.array([[0.1, 0.0, 0.2]]))


def sided(weight, half, rng):
    """A hypothesis in which joint 3 is softer one way by twice `half`."""
    one = hypothesis(weight, instead="joint_asymmetry:3")
    x = one.estimate.value.copy()
    x[7] = half * X[2]
    half_cov = 0.01 * np.append(X, X[2])[:, None] * (rng.normal(size=(8, 8)) + 2 * np.eye(8))
    estimate = replace(one.estimate, value=x, cov=half_cov @ half_cov.T)
    system = replace(one.system, B=rng.normal(size=(3, 8)))
    cell = paper_cell(KR500, TOOL).with_effects(SIDED)
    return replace(one, cell=cell, estimate=estimate, system=system)


def test_a_sided_joint_has_a_compliance_for_each_way():
    """C + dc and c - dc, by propagation; elsewhere, and in other hypotheses, both are c."""
    rng = np.random.default_rng(7)
    one, other = sided(0.6, 0.2, rng), hypothesis(0.4)
    joint = SIDED.carrier[0] - 1
    V, x = one.estimate.cov, one.estimate.value
    found = each_way([replace(one, weight=1.0)], joint)
    for k, sign in enumerate((1.0, -1.0)):
        assert found.value[k] == pytest.approx(x[joint] + sign * x[7])
        variance = V[joint, joint] + V[7, 7] + 2 * sign * V[joint, 7]
        assert found.std[k] == pytest.approx(np.sqrt(variance))
    assert found.cov[0, 1] == pytest.approx(V[joint, joint] - V[7, 7])
    held = each_way([one, other], joint, SIDED)
    np.testing.assert_allclose(held.value, found.value)
    both = each_way([one, other], joint)
    np.testing.assert_allclose(both.value, 0.6 * found.value + 0.4 * X[joint])
    alone = each_way([other], joint)
    assert alone.value[0] == alone.value[1] == X[joint]
    plain = each_way([replace(one, weight=1.0)], joint + 1)
    assert plain.value[0] == plain.value[1] == x[joint + 1]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_at_a_pose_a_sided_joint_has_the_compliance_of_its_torque(way):
    """By the sign of r x F about its axis; the rows of the system stay what they are."""
    rng = np.random.default_rng(8)
    one, q = sided(1.0, 0.2, rng), np.array([3.0, 0.1, -1.2, 1.3, 0.2, 0.4, 0.1])
    one = replace(one, sized=replace(one.estimate, value=2 * one.estimate.value))
    joint, force = SIDED.carrier[0] - 1, way * np.array([200.0, -300, 900])
    (same,) = average_module.at_pose([hypothesis(1.0)], q, force)
    assert same.estimate.value.tolist() == hypothesis(1.0).estimate.value.tolist()
    (found,) = average_module.at_pose([one], q, force)

    step = np.eye(7)[joint] * 1e-6  # the load point moves by dq, against which the force works
    ahead, behind = (configure(KR500, (q + s)[None]).points(TOOL.load_point[None])[0, 0]
                     for s in (step, -step))  # fmt: skip
    side = np.sign((ahead - behind) @ force)
    expected = one.estimate.value[joint] + side * one.estimate.value[7]
    assert found.estimate.value[joint] == pytest.approx(expected)
    assert found.sized.value[joint] == pytest.approx(2 * expected)
    others = np.arange(8) != joint
    assert found.estimate.value[others].tolist() == one.estimate.value[others].tolist()
    np.testing.assert_allclose(
        found.system.B @ found.estimate.value, one.system.B @ one.estimate.value, atol=1e-18
    )


def test_a_sum_that_all_hypotheses_determine_is_averaged(monkeypatch):
    """Only c_5 + c_6 is known, in typical sizes: its value, and ends that hold for each."""
    typical = np.array([p.typical for p in BASELINE])
    u = np.zeros(7)
    u[5], u[6] = typical[5], typical[6]  # the mix in typical sizes that is c_5 + c_6
    N = np.diag([1e4] * 5 + [0.0, 0.0]) + 1e4 * np.outer(u, u) / (u @ u)
    one, other = hypothesis(0.7), hypothesis(0.3, 1.1, instead="joint_tilt:6")
    alone = np.arange(7) < 5
    for several in ([replace(one, weight=1.0)], [one, other]):
        monkeypatch.setattr(average_module, "_informations", lambda each: np.stack([N] * len(each)))
        (mix,) = average_module.together(several, N, alone)
        assert mix.of.tolist() == [5, 6]
        np.testing.assert_allclose(mix.weights, [1.0, 1.0])
        values = [h.estimate.value[5] + h.estimate.value[6] for h in several]
        assert mix.value == pytest.approx(np.dot([h.weight for h in several], values))
        std = 0.01 * np.sqrt(u @ u)
        assert mix.std == pytest.approx(std)
        assert mix.low == pytest.approx(min(values) - 1.96 * std, rel=1e-3)
        assert mix.high == pytest.approx(max(values) + 1.96 * std, rel=1e-3)
    whole = np.diag(np.full(7, 1e4))
    assert average_module.together([one], whole, np.full(7, True)) == ()
