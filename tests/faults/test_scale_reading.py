"""A mistyped reading of the scale: corrected value and certainty, by dense fits of all else."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize, stats
from small_case import asked, moved, small, where

from pipeline.faults import scale_reading
from pipeline.faults.fault import Screening
from pipeline.faults.mistake import lines_of
from pipeline.faults.scale_reading import (
    _chance,
    _Errors,
    _fitting,
    _freed,
    scale_outliers,
)
from pipeline.machine.cell import predict
from pipeline.machine.effects import catalogue
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import Scale
from pipeline.system import alarms
from pipeline.system.whiten import whitener


def typed(case, pose, repeat, change):
    """Another number in a line of the scale's log."""
    loads = case.loads.copy()
    row = (loads["pose"] == pose) & (loads["repeat"] == repeat)
    loads.loc[row, "force_n"] = change(loads.loc[row, "force_n"])
    return replace(case, loads=loads)


@pytest.fixture(scope="module")
def case():
    return small(8, scale={"sigma_n": 3.0})


@pytest.fixture(scope="module")
def clean(case):
    return asked(case)


def freed(asked):
    white = whitener(asked.system.errors, asked.system.rows.pose)
    data = asked.reduced.data
    return _freed(asked.cell, data, asked.system, asked.estimate, white)[1]


def dense(asked):
    """Inverse Cholesky factor of the whole covariance, and springs in units of the nominal."""
    G = asked.system.errors.G.toarray()
    W = np.linalg.inv(np.linalg.cholesky(G @ G.T))
    return W, asked.system.B * asked.case.robot.nominal_compliance


def by_newton(asked, pull, step=1.0):
    """Effect of one newton more in a pull, by the forward model itself, shape (rows,)."""
    data = asked.reduced.data
    force = data.pulls.force.copy()
    force[pull] *= 1 + step / np.linalg.norm(force[pull])
    more = replace(data.pulls, force=force)
    at = (data.pull, data.target)
    old, new = (
        predict(asked.cell, pulls, asked.estimate.value).displacement[at]
        for pulls in (data.pulls, more)
    )
    return (new - old).ravel() / step


def test_every_pull_is_freed_as_a_dense_fit_frees_it(clean):
    """Drop, size [N] and uncertainty of each, with springs and all stated errors."""
    found = freed(clean)
    W, B = dense(clean)
    y = W @ clean.system.c
    before = np.linalg.lstsq(W @ B, y, rcond=None)[1][0]

    assert found.drop.shape == (12,)
    assert found.dof == len(y) - 7
    assert found.rest == pytest.approx(before, rel=1e-6)
    for pull in (0, 5, 11):
        X = W @ np.column_stack([B, by_newton(clean, pull)])
        x, rest, *_ = np.linalg.lstsq(X, y, rcond=1e-15)
        assert found.size[pull, 0] == pytest.approx(x[-1], rel=1e-4)
        assert found.drop[pull] == pytest.approx(before - rest[0], rel=1e-4)
        spread = np.linalg.inv(X.T @ X / np.outer(*[np.linalg.norm(X, axis=0)] * 2))[-1, -1]
        std = np.sqrt(spread) / np.linalg.norm(X[:, -1])
        assert found.N[pull, 0, 0] ** -0.5 == pytest.approx(std, rel=1e-4)


def test_the_reading_that_fits_is_the_smallest_misfit(case):
    """Ten times the force in one pull: the force of least misfit of all rows, by scipy."""
    wrong = asked(typed(case, 3, 1, lambda f: 10 * f))
    data, pull = wrong.reduced.data, 4
    assert (data.pulls.pose[pull], data.pulls.repeat[pull]) == (3, 1)
    scale = case.settings.scale

    (size,) = _fitting(wrong, _Errors.among(wrong.case, data).only(np.array([pull])), scale)
    found = np.linalg.norm(data.pulls.force[pull]) - size

    right = asked(case)
    W, B = dense(right)  # weights of the readings as they should be
    here = right.system.rows.pull == pull
    given = np.linalg.norm(right.reduced.data.pulls.force[pull])

    def misfit(force):
        X = W @ np.where(here[:, None], B * force / given, B)
        return np.linalg.lstsq(X, W @ right.system.c, rcond=None)[1][0]

    best = optimize.minimize_scalar(misfit, bracket=(0.9 * given, 1.1 * given), tol=1e-10).x
    assert found == pytest.approx(best, rel=1e-3)
    assert found == pytest.approx(given, rel=0.05)


@pytest.mark.parametrize(("per", "unit"), [(4.4482216152605, "lbf"), (9.80665, "kgf")])
def test_the_number_that_was_meant_is_one_of_the_log(case, per, unit):
    """Its first two digits exchanged, in the unit of the log; gain and zero of the scale aside."""
    settings = case.settings.model_copy(
        update={"scale": case.settings.scale.model_copy(update={"gain": 1.02, "zero_n": 15.0})}
    )
    force = case.loads.set_index(["pose", "repeat"]).loc[(5, 2), "force_n"]
    shown = f"{(1.02 * force + 15.0) / per:.0f}"
    wrong = shown[1] + shown[0] + shown[2:]
    given = typed(case, 5, 2, lambda _: (float(wrong) * per - 15.0) / 1.02)
    given = replace(given, settings=settings, loads=given.loads.assign(unit_n=per))

    (found,) = scale_reading.FAULT.find(asked(given))

    assert f" says {wrong} {unit}, and all other pulls agree with " in found.evidence
    assert found.evidence.endswith(f"two digits exchanged, {shown} {unit} may have been meant")
    assert found.size == pytest.approx(abs(float(wrong) - float(shown)) * per / 1.02, rel=0.02)


def test_what_the_model_misses_makes_the_reading_that_fits_less_certain():
    """Springs alone, and a carriage that rolls: wider by the root of chi-square per freedom."""
    given = small(8, scale={"sigma_n": 3.0}, hidden={"effects": ["rail_roll=3x"]})
    force = given.loads.set_index(["pose", "repeat"]).loc[(5, 2), "force_n"]
    clean = asked(given)
    W, B = dense(clean)
    y = W @ clean.system.c
    ratio = np.linalg.lstsq(W @ B, y, rcond=None)[1][0] / (len(y) - B.shape[1])
    assert ratio > 4

    (found,) = scale_reading.FAULT.find(asked(typed(given, 5, 2, lambda f: 10 * f)))

    fits, std = (
        float(part.split()[0]) for part in found.evidence.split("agree with ")[1].split("± ")
    )
    assert std == pytest.approx(freed(clean).N[9, 0, 0] ** -0.5 * np.sqrt(ratio), rel=0.2)
    assert abs(fits - force) < 3 * std


@pytest.mark.sampled(1)
@pytest.mark.parametrize("factor", [10.0, 0.1, 1.3])
def test_a_mistyped_reading_is_found_with_what_it_should_be(case, factor):
    """Ten times, a tenth, and exchanged digits: place, size and the value from the others."""
    wrong = typed(case, 5, 2, lambda f: factor * f)

    (found,) = scale_reading.FAULT.find(asked(wrong))

    force = case.loads.set_index(["pose", "repeat"]).loc[(5, 2), "force_n"]
    line = case.loads.set_index(["pose", "repeat"]).loc[(5, 2), "line"]
    assert found.where == "loads.csv pose05 rep2"
    assert f"(line {line}) says {factor * force:.6g} N" in found.evidence
    std = freed(asked(case)).N[9, 0, 0] ** -0.5
    assert found.size == pytest.approx(abs(factor - 1) * force, abs=4 * std)
    assert found.before == pytest.approx(found.size / std, rel=0.02)
    told = float(found.evidence.split(" ± ")[1].split()[0])
    assert told == pytest.approx(std, rel=0.06)
    assert found.p_value < alarms.READING
    right = found.correct(wrong)
    assert len(right.loads) == len(case.loads) - 1
    assert not ((right.loads["pose"] == 5) & (right.loads["repeat"] == 2)).any()
    assert scale_reading.FAULT.find(asked(right)) == []


def places(findings):
    """Pose and repeat of each finding."""
    words = [one.where.split() for one in findings]
    return sorted((int(pose[-2:]), int(repeat[-1:])) for _, pose, repeat in words)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "factors",
    [
        {(5, 2): 1.5, (2, 1): 1.5},
        {(5, 2): 1.5, (2, 1): 1 / 1.5},
        {(5, 2): 1.5, (2, 1): 1.4, (3, 1): 0.6},
        {(4, 1): 1.3, (4, 2): 1.3},
    ],
)
def test_mistyped_readings_that_hide_each_other_are_found_together(case, factors):
    """Alike, opposed, three of twelve, both pulls of a pose: each is named, and no other."""
    wrong = case
    for (pose, repeat), factor in factors.items():
        wrong = typed(wrong, pose, repeat, lambda f, factor=factor: factor * f)

    found = scale_reading.FAULT.find(asked(wrong))

    assert places(found) == sorted(factors)
    force = case.loads.set_index(["pose", "repeat"])["force_n"]
    for (pose, repeat), one in zip(
        places(found), sorted(found, key=lambda one: one.where), strict=True
    ):
        expected = abs(factors[pose, repeat] - 1) * force.loc[(pose, repeat)]
        assert one.size == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("zeros", [{4: 250.0}, {2: 300.0, 5: -250.0}])
def test_a_scale_that_was_not_zeroed_in_a_pose(case, zeros):
    """All forces of one or two poses too large or too small alike: lines and sizes."""
    pose = case.loads["pose"]
    wrong = replace(
        case, loads=case.loads.assign(force_n=case.loads["force_n"] + pose.map(zeros).fillna(0.0))
    )

    found = scale_reading.FAULT.find(asked(wrong))

    assert [one.where for one in found] == [f"loads.csv pose{k:02d}" for k in zeros]
    for one, (k, size) in zip(found, zeros.items(), strict=True):
        assert one.at == lines_of(case.loads[pose == k])
        told, within = one.evidence.split(" are ")[1].split(" N too ")[0].split(" N ± ")
        assert float(told) == pytest.approx(abs(size), abs=4 * float(within))
        assert (" too large" in one.evidence) is (size > 0)
        assert set(one.correct(wrong).loads["pose"]) == set(pose) - {k}
        assert not one.rivalled


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("since", "law", "also"),
    [
        (4, lambda f: f + 250.0, None),
        (3, lambda f: f + 250.0, None),
        (3, lambda f: f - 250.0, (2, 1)),
        (4, lambda f: f + 250.0, (6, 2)),
    ],
)
def test_another_zero_of_the_scale_since_a_pose_waits_for_the_causes(case, since, law, also):
    """The last three or four poses of six: one zero, and a wrong reading in one or not."""
    late, force = case.loads["pose"] >= since, case.loads["force_n"]
    wrong = replace(case, loads=case.loads.assign(force_n=force.where(~late, law(force))))
    wrong = wrong if also is None else typed(wrong, *also, lambda f: 1.6 * f)

    *single, found = scale_reading.FAULT.find(asked(wrong))

    assert found.at == lines_of(case.loads[late])
    assert found.rivalled
    assert places(single) == ([] if also is None else [also])


def test_a_wrong_reading_in_a_pose_without_a_zero_is_named_beside_it():
    """Three of four forces are too large alike, the other one by its own."""
    four = small(8, scale={"sigma_n": 3.0}, pulls={"steps_n": [600.0, 1200.0, 2000.0, 1600.0]})
    loads = four.loads.assign(force_n=four.loads["force_n"] + 250.0 * (four.loads["pose"] == 4))

    found = scale_reading.FAULT.find(
        asked(typed(replace(four, loads=loads), 4, 2, lambda f: 1.3 * f))
    )

    assert [one.where for one in found] == ["loads.csv pose04 rep2", "loads.csv pose04"]


def test_two_lines_of_the_log_exchanged_are_found(case):
    """Each pull has the other's force, as if two rows of a list were exchanged."""
    force = case.loads.set_index(["pose", "repeat"])["force_n"]
    ends = [force.idxmax(), force.idxmin()]
    wrong = typed(case, *ends[0], lambda _: force.loc[ends[1]])
    wrong = typed(wrong, *ends[1], lambda _: force.loc[ends[0]])

    found = scale_reading.FAULT.find(asked(wrong))

    assert places(found) == sorted(ends)
    one, other = found
    line = other.at[0].rpartition(":")[2]
    assert one.evidence.endswith(f"; the number of line {line} may have been meant")


def test_what_all_pulls_share_is_no_mistyped_reading(case):
    """A reading that grows with the power 1.3, and a wandering zero: not typing errors."""
    loads = case.loads
    for change in (lambda f: f * (f / f.mean()) ** 0.3, lambda f: f + 300 * np.sin(np.arange(12))):
        other = replace(case, loads=loads.assign(force_n=change(loads["force_n"])))
        assert scale_reading.FAULT.find(asked(other)) == []


def test_a_reading_that_dominates_no_other_waits_for_the_causes():
    """A few newtons beyond chance: a mistake only after causes were sought."""
    exact = small(8, tracker={"sigma_m": 1e-4}, scale={"sigma_n": 3.0})
    force = exact.loads["force_n"].to_numpy()
    sizes = [asked(typed(exact, 5, 2, lambda f, k=k: f + k * force.max())) for k in (0.05, 0.5)]
    found = [scale_reading.FAULT.find(one) for one in sizes]
    assert [[one.where for one in each] for each in found] == 2 * [["loads.csv pose05 rep2"]]

    weak, gross = (each[0] for each in found)

    assert weak.rivalled
    assert not gross.rivalled
    assert sizes[1].sure(gross)
    assert not sizes[0].sure(weak)
    assert replace(sizes[0], beside_causes=True).sure(weak)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("factors", "waits"), [((1.3, 1.3), 1), ((1.3, 1.5), 0), ((3.0, 3.0), 0)])
def test_a_pose_whose_two_pulls_share_a_factor_waits_for_the_causes(case, factors, waits):
    """The machine may be softer there; not by a factor of three, and not by two factors at once."""
    wrong = case
    for repeat, factor in zip((1, 2), factors, strict=True):
        wrong = typed(wrong, 4, repeat, lambda f, factor=factor: factor * f)

    found = scale_reading.FAULT.find(asked(wrong))

    assert places(found) == [(4, 1), (4, 2)]
    assert [one.rivalled for one in found] == 2 * [bool(waits)]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(4))
def test_beside_other_pulls_that_stand_out_none_waits_to_be_named(seed):
    """Each pull moves by 0.3 mm on its own: one force 30 % off dominates, or is none."""
    case, rng = (
        small(8, tracker={"sigma_m": 1e-5}, scale={"sigma_n": 3.0}),
        np.random.default_rng(seed),
    )
    rows = case.readings
    own = (rows["state"] == "loaded") & rows["target"].isin(case.settings.measured)
    for group in rows.loc[own, "group"].unique():
        case = moved(
            case, (own & (rows["group"] == group)).to_numpy(), 3e-4 * rng.standard_normal(3)
        )

    found = scale_outliers(asked(typed(case, 5, 2, lambda f: 1.3 * f)))

    assert not any(one.rivalled for one in found)


def test_a_weaker_second_one_is_named_after_the_first(case):
    """Ten times in one line and a tenth more in another."""
    both = typed(typed(case, 5, 2, lambda f: 10 * f), 2, 2, lambda f: 1.1 * f)

    (first,) = scale_reading.FAULT.find(asked(both))
    (second,) = scale_reading.FAULT.find(asked(first.correct(both)))

    assert (first.where, second.where) == ("loads.csv pose05 rep2", "loads.csv pose02 rep2")


def test_what_was_not_mistyped_is_not_called_so():
    """0.02 of the force is no wrong digit, 0.04 is; nor are six uncertainties of a poor scale."""
    exact = small(8, tracker={"sigma_m": 2e-6}, scale={"sigma_n": 3.0})

    def find(factor, scale=None):
        wrong = asked(typed(exact, 5, 2, lambda f: factor * f))
        if scale is None:
            return scale_reading.FAULT.find(wrong)
        settings = wrong.case.settings.model_copy(update={"scale": scale})
        poor = replace(wrong.case, settings=settings)
        return scale_outliers(replace(wrong, case=poor, known=wrong.reduced))

    assert find(1.022) == []
    assert len(find(1.045)) == 1
    assert len(find(0.955)) == 1
    off = find(1.08)[0].size
    assert find(1.08, Scale(sigma_n=off / 6 * 1.02)) == []
    assert len(find(1.08, Scale(sigma_n=3.0))) == 1


def test_few_pulls_single_none_out(case, monkeypatch):
    """Seven are too few, and more than a thousand are not typed by hand."""
    wrong = asked(typed(case, 5, 2, lambda f: 10 * f))
    for fewest, most, said in ((12, 12, True), (13, 99, False), (8, 11, False)):
        monkeypatch.setattr(scale_reading, "_FEWEST", fewest)
        monkeypatch.setattr(scale_reading, "_MOST", most)
        assert bool(scale_outliers(wrong)) is said
    assert (alarms.READING, len(wrong.reduced.data.pulls)) == (2e-4, 12)


def test_clean_draws_are_accused_no_more_often_than_the_rate(clean):
    """1000 draws from the stated errors: the worst of twelve pulls, with p corrected for all."""
    white = whitener(clean.system.errors, clean.system.rows.pose)
    data = clean.reduced.data
    base, _ = _freed(clean.cell, data, clean.system, clean.estimate, white)
    columns = np.stack([by_newton(clean, pull) for pull in range(12)], axis=1)
    D = white(columns)[None, ..., None]
    G, rng = clean.system.errors.G, np.random.default_rng(4)
    least = []
    for _ in range(1000):
        now = base.against(white(G @ rng.standard_normal(G.shape[1]))).beside(D).of_block(0)
        least.append(_chance(now, clean.system).min())
    share = np.mean(np.array(least) < 0.1)

    # F with s of one at least: p is overstated if the residuals are small
    assert 0.03 < share < stats.binom.ppf(0.999, 1000, 0.1) / 1000


def test_a_modest_certificate_is_believed_and_none_is_not(clean):
    """Residuals half as large as stated count as stated; without a statement they count."""
    found = freed(clean)
    small_rest = replace(found, rest=found.rest / 4, g=found.g / 2)
    stated, unstated = SimpleNamespace(noise_stated=True), SimpleNamespace(noise_stated=False)

    drop = found.drop / 4
    left = (found.rest / 4 - drop) / (found.dof - 1)
    assert (left < 1).all()
    expected = 12 * stats.f.sf(drop, 1, found.dof - 1)
    np.testing.assert_allclose(_chance(small_rest, stated), expected, rtol=1e-9)
    expected = 12 * stats.f.sf(drop / left, 1, found.dof - 1)
    np.testing.assert_allclose(_chance(small_rest, unstated), expected, rtol=1e-9)


def test_a_scale_is_as_sure_of_the_right_reading_as_it_states():
    """0.01 of the reading: at ten times the force ten times as much."""
    case = small(8, scale={"sigma_n": 1.0, "sigma_rel": 0.01})
    wrong = typed(case, 5, 2, lambda f: 10 * f)

    (found,) = scale_reading.FAULT.find(asked(wrong))

    std = freed(asked(case)).N[9, 0, 0] ** -0.5
    told = float(found.evidence.split(" ± ")[1].split()[0])
    assert told == pytest.approx(std, rel=0.06)
    assert std > 30.0


def test_where_no_noise_is_stated_the_other_pulls_are_the_noise():
    """The residual sum of squares is that with the right reading."""
    case = small(8, tracker={"stated": False})
    (found,) = scale_reading.FAULT.find(asked(typed(case, 5, 2, lambda f: 1.3 * f)))

    right = freed(asked(case))
    drop = found.before**2
    expected = np.log(12) + stats.f.logsf(drop / (right.rest / (right.dof - 1)), 1, right.dof - 1)
    assert np.log(found.p_value) == pytest.approx(expected, rel=0.1)


@pytest.mark.whole
def test_a_law_that_is_wrong_in_one_pull_is_no_mistyped_reading(case):
    """A joint turns half as far again by its hardening in one pull: who knows the law can tell."""
    exact = small(8, tracker={"sigma_m": 1e-5}, scale={"sigma_n": 3.0})
    plain = asked(exact)
    data = plain.reduced.data
    every = catalogue(exact.robot, data.pulls)
    law = next(one for one in every if one.label == "joint_hardening:2")
    cell, springs = exact.cell.with_effects(law), plain.estimate.value
    size = 6 * np.array([p.typical for p in law.parameters])
    bent, straight = (
        predict(cell, data.pulls, np.append(springs, part)).displacement
        for part in (size, 0 * size)
    )
    pull, rows = 11, exact.readings.copy()
    share = np.where(np.arange(len(data.pulls)) == pull, 1.5, 1.0)
    off = share[data.pull, None] * (bent - straight)[data.pull, data.target]
    by = dict(
        zip(
            zip(data.pulls.pose[data.pull], data.pulls.repeat[data.pull], data.name, strict=True),
            off @ plain.reduced.registration.R,
            strict=True,
        )
    )
    for k in rows.index[rows["state"] == "loaded"]:
        key = rows.loc[k, "pose"], rows.loc[k, "repeat"], rows.loc[k, "target"]
        rows.loc[k, XYZ] = rows.loc[k, XYZ].to_numpy(float) + by.get(key, 0.0)
    hardened = replace(exact, readings=rows)
    start = np.append(springs, size)

    def found(suspects, of=hardened):
        return scale_outliers(Screening(of, cell, start, None, None, True, suspects))

    told = found(every)
    blind = [one.where for one in found(())]

    assert blind == ["loads.csv pose06 rep2"]
    assert told == []
    gross = typed(hardened, 2, 1, lambda f: 3 * f)
    assert [one.where for one in found(every, gross)] == ["loads.csv pose02 rep1"]


def test_a_pull_in_which_one_target_alone_is_off_is_no_wrong_force():
    """Along its own displacement by many standard deviations, as the tails of a tracker are."""
    given = small(8, tracker={"sigma_m": 3e-5}, scale={"sigma_n": 3.0})
    size = 0.3 * given.loads.set_index(["pose", "repeat"]).loc[(5, 2), "force_n"]
    rows = given.readings
    here = (rows["pose"] == 5) & (rows["target"] == "P1")
    at = rows[here & (rows["repeat"] == 2) & (rows["state"] == "loaded")]
    zero = rows[here & (rows["state"] == "unloaded")][XYZ].mean().to_numpy(float)
    along = at[XYZ].to_numpy(float)[0] - zero
    off = 14 * 3e-5 * along / np.linalg.norm(along)
    tailed = moved(given, where(given, at["group"].iloc[0], "P1"), off)
    wrong = typed(given, 5, 2, lambda f: f + size * 0.2)
    assert [one.where for one in scale_outliers(asked(wrong))] == ["loads.csv pose05 rep2"]
    assert scale_outliers(asked(tailed)) == []


@pytest.mark.parametrize("first", [3, 5])
def test_two_readings_that_take_each_others_place_are_both_wrong(monkeypatch, first):
    """Each explains the log better than the other does alone, and nothing is left beside both."""

    def righted(asked, among, which):
        alone = len(which) == 1
        return SimpleNamespace(
            matters=True,
            exchanged=np.array([8 - which[0]]) if alone else which,
            alone=not alone,
            clear=False,
            more=np.array([3, 5]),
        )

    monkeypatch.setattr(scale_reading, "_righted", righted)
    start = SimpleNamespace(among=SimpleNamespace(of=np.zeros((40, 40))), more=np.array([first]))

    both = scale_reading._together(None, start)

    assert both is not None
    assert both.exchanged.tolist() == [3, 5]
