"""Covariances stated in another frame or unit: planted, named, and corrected."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.base import covariance
from pipeline.faults.covariance_stated import misstated
from pipeline.faults.fault import Screening
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

PLAN = Plan(name="good", seed=23, poses={"count": 12})
ACROSS, ALONG = 1.5e-4, 1e-5


@cache
def good():
    """A campaign whose readings scatter as the covariance of each in the export states [m]."""
    case = ingested(in_memory(simulate(PLAN).files), plausible=False)
    rows, rng = case.readings, np.random.default_rng(7)
    points = rows[["x_m", "y_m", "z_m"]].to_numpy(float)
    C = shell(points)
    added = np.linalg.cholesky(C) @ rng.standard_normal((len(C), 3, 1))
    rows = rows.assign(**dict(zip(["x_m", "y_m", "z_m"], (points + added[..., 0]).T, strict=True)))
    noise = covariance.matrices(case.readings)  # as the campaign already has
    return stated(replace(case, readings=rows), C + noise)


def shell(points, along=ALONG):
    """Covariances along the beam to each point and across it."""
    unit = points / np.linalg.norm(points, axis=1)[:, None]
    return ACROSS**2 * np.eye(3) + (along**2 - ACROSS**2) * unit[:, :, None] * unit[:, None, :]


@cache
def by_axes(seed, middle):
    """A campaign that scatters along each axis by itself, with the variances that a beam has.

    The tracker stands where the mean of all readings is at `middle` [m].
    """
    case = ingested(in_memory(simulate(PLAN).files), plausible=False)
    rows, rng = case.readings, np.random.default_rng(seed)
    points = rows[["x_m", "y_m", "z_m"]].to_numpy(float)
    points += np.array(middle) - points.mean(axis=0)
    std = np.sqrt(np.einsum("mii->mi", shell(points, 0.2 * ACROSS)))
    points += std * rng.standard_normal(points.shape)
    rows = rows.assign(**dict(zip(["x_m", "y_m", "z_m"], points.T, strict=True)))
    return stated(replace(case, readings=rows), shell(points, 0.2 * ACROSS))


def stated(case, C):
    six = dict(zip(covariance.columns(), covariance.flat(C).T, strict=True))
    return replace(case, readings=case.readings.assign(covariance_from="file", **six))


def asked(case):
    return Screening(case, case.cell, case.robot.nominal_compliance)


def along_the_beam(case):
    """The same numbers in an export that states them along the beam and in two axes across it."""
    own = np.linalg.eigvalsh(covariance.matrices(case.readings))
    return stated(case, own[:, :, None] * np.eye(3))


def along_the_base(case):
    """The same in an export that rotated them into the base frame."""
    R = bring(case).registration.R
    return stated(case, R @ covariance.matrices(case.readings) @ R.T)


def test_covariances_in_the_frame_of_the_tracker_are_left_alone():
    """In the frame of the readings: nothing to report."""
    assert misstated(asked(good())) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("middle", [(-1.0, 3.0, -2.0), (0.0, 0.0, 2.5)])
def test_axes_that_scatter_by_themselves_are_no_other_frame(middle, seed):
    """Correlations of a beam are added where a file states none, and need not be there."""
    assert misstated(asked(by_axes(seed, middle))) == []


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("plant", "says"), [(along_the_beam, "the tracker's beam"), (along_the_base, "the base frame")]
)
def test_another_frame_is_named_and_turned_back(plant, says):
    """The corrected covariances are the true ones, whatever the signs of the axes."""
    (found,) = misstated(asked(plant(good())))

    assert found.name == "sign_or_convention"
    assert f"along {says}" in found.evidence
    assert found.after == pytest.approx(1.0, abs=0.15)
    got = covariance.matrices(found.correct(plant(good())).readings)
    true = covariance.matrices(good().readings)
    assert np.abs(got - true).max() < 1e-3 * np.abs(true).max()


def test_one_figure_for_all_axes_has_no_frame():
    """Isotropic covariances need no rotation."""
    case = good()
    assert (
        misstated(asked(stated(case, np.tile(ACROSS**2 * np.eye(3), (len(case.readings), 1, 1)))))
        == []
    )


def with_spread(case, change):
    """Covariances with other standard uncertainties [mm] along their own axes."""
    size, axes = np.linalg.eigh(covariance.matrices(case.readings))
    new = 1e-3 * change(1e3 * np.sqrt(size))
    return stated(case, axes @ (new[:, :, None] ** 2 * np.eye(3)) @ np.linalg.inv(axes))


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda mm: mm / 1000, "1,000 times too small"),  # metres in a column of millimetres
        (lambda mm: mm * 1000, "1,000 times too large"),  # micrometres
        (lambda mm: mm**2, "variances in mm^2 and were read as standard uncertainties"),
        (
            lambda mm: 1e3 * np.sqrt(1e-3 * mm),
            "standard uncertainties in m and were read as variances in m^2",
        ),
    ],
)
def test_another_unit_is_named_and_put_right(change, said):
    """The corrected covariances are the true ones."""
    case = with_spread(good(), change)

    (found,) = misstated(asked(case))

    assert (found.name, found.where) == ("unit_mixup", "covariance")
    assert said in found.evidence
    assert found.after == pytest.approx(1.0, abs=0.15)
    got = covariance.matrices(found.correct(case).readings)
    true = covariance.matrices(good().readings)
    assert np.abs(got - true).max() < 1e-6 * np.abs(true).max()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("times", [0.2, 12.0, 200.0, 0.5, 2.0, 5.0])
def test_a_certificate_that_is_merely_wrong_is_no_unit(times):
    """A factor that is no ratio of units or of their squares is left to the noise."""
    assert misstated(asked(with_spread(good(), lambda mm: times * mm))) == []


@pytest.mark.sampled(1)
@pytest.mark.parametrize("far_mm", [1.0, 5.0, 20.0, 30.0])
@pytest.mark.parametrize("part", [0.1, 0.3])
def test_many_readings_that_are_off_are_no_unit(part, far_mm):
    """A tenth or a third of all readings far off, by as much as a unit could be."""
    case, rng = good(), np.random.default_rng(3)
    off = far_mm * 1e-3 * rng.standard_normal((len(case.readings), 3))
    off *= (rng.random(len(off)) < part)[:, None]
    rows = case.readings
    moved = {f"{axis}_m": rows[f"{axis}_m"] + off[:, k] for k, axis in enumerate("xyz")}
    said = misstated(asked(replace(case, readings=rows.assign(**moved))))
    assert [one.name for one in said if one.name == "unit_mixup"] == []


@pytest.mark.parametrize("name", ["P1", "P3"])
def test_one_target_that_moves_does_not_misstate_all_readings(name):
    """Its readings scatter 5 times as stated, those of the others as stated."""
    rows, rng = good().readings, np.random.default_rng(3)
    mine = (rows["target"] == name).to_numpy()
    shift = np.where(mine[:, None], 5 * ACROSS * rng.standard_normal((len(rows), 3)), 0.0)
    points = rows[["x_m", "y_m", "z_m"]] + shift

    assert misstated(asked(replace(good(), readings=rows.assign(**points)))) == []


def test_a_campaign_of_one_target_is_not_asked_without_it():
    """Its repeated zeros scatter three times as stated, which no unit explains."""
    rows = good().readings
    gone = rows["target"].isin([name for name in good().settings.measured if name != "P1"])
    C = covariance.matrices(rows[~gone]) / 9

    assert misstated(asked(stated(replace(good(), readings=rows[~gone]), C))) == []
