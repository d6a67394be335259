"""Uncertainty of a tracker's reading, against its own axes and draws of its angles."""

import numpy as np
import pytest
from small_case import PLAN

from pipeline.base import covariance
from pipeline.machine import instrument
from pipeline.machine.instrument import (
    InstrumentNoise,
    beam_covariance,
    correlated,
    near,
    sheet,
    sheets,
)
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import revised, simulate
from pipeline.store.campaign import in_memory

NOISE = InstrumentNoise(range_m=8e-6, range_per_m=4e-7, transverse_m=1.5e-5, transverse_per_m=6e-6)


def test_along_and_across_the_beam_the_data_sheet_says():
    """Constant and part per metre add linearly, one pair along the beam, one across it."""
    position = np.array([[3.0, -4.0, 12.0], [0.0, 0.0, -2.0], [20.0, 1.0, 0.3]])
    found = covariance.symmetric(beam_covariance(position, NOISE))

    for at, C in zip(position, found, strict=True):
        reach = np.linalg.norm(at)
        along, across = 8e-6 + 4e-7 * reach, 1.5e-5 + 6e-6 * reach
        beam = at / reach
        side = np.cross(beam, [0.3, 0.5, -0.7])
        side /= np.linalg.norm(side)
        for axis, sigma in ((beam, along), (side, across), (np.cross(beam, side), across)):
            assert C @ axis == pytest.approx(sigma**2 * axis, rel=1e-9, abs=1e-20)


def test_the_covariance_is_that_of_a_range_and_two_angles():
    """Draws of the range and both angles of a theodolite: points scatter as stated."""
    rng, reach = np.random.default_rng(6), 5.0
    azimuth, elevation = 0.7, -0.4

    def point(range_m, left, up):
        flat = range_m * np.cos(elevation + up)
        return np.stack(
            [
                flat * np.cos(azimuth + left),
                flat * np.sin(azimuth + left),
                range_m * np.sin(elevation + up),
            ],
            axis=-1,
        )

    angle = (1.5e-5 + 6e-6 * reach) / reach
    e = rng.standard_normal((3, 200_000))
    drawn = point(
        reach + (8e-6 + 4e-7 * reach) * e[0], angle / np.cos(elevation) * e[1], angle * e[2]
    )
    (C,) = covariance.symmetric(beam_covariance(point(reach, 0.0, 0.0)[None], NOISE))

    assert np.cov(drawn.T) == pytest.approx(C, rel=0.02, abs=0.01 * np.trace(C))


def test_at_the_origin_the_larger_part_counts_all_round():
    """A reading without a beam, whichever component of the instrument is larger."""
    poor_range = InstrumentNoise(range_m=5e-5, transverse_m=1e-5, transverse_per_m=1e-3)

    for noise, sigma in ((NOISE, 1.5e-5), (poor_range, 5e-5)):
        found = covariance.symmetric(beam_covariance(np.zeros((2, 3)), noise))
        assert found == pytest.approx(np.stack([sigma**2 * np.eye(3)] * 2), abs=1e-24)


def test_the_papers_share_is_the_mean_over_its_angles():
    """E[u u'] of theta uniform on [0, pi/2] and phi uniform, by quadrature, Eq. (18)."""
    half = np.pi / 2
    theta, phi = np.meshgrid(
        (np.arange(200) + 0.5) / 200 * half, (np.arange(200) + 0.5) / 200 * 2 * np.pi
    )
    u = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    ).reshape(-1, 3)
    shares = covariance.symmetric(np.stack([instrument.PAPER_SHARE, instrument.ISOTROPIC]))

    assert shares[0] == pytest.approx(u.T @ u / len(u), abs=1e-6)
    assert shares[1] == pytest.approx(np.eye(3))


@pytest.mark.parametrize(
    ("written", "listed"),
    [
        ("Leica AT960-MR", "Leica AT960-MR"),
        ("leica absolute tracker at 960 MR", "Leica AT960-MR"),
        ("AT402", "Leica AT402"),
        ("FARO Laser Tracker Vantage S6", "FARO Vantage S6"),
        ("API Tracker3", "API Tracker3"),
        ("Vantage", "FARO Vantage"),
    ],
)
def test_a_type_is_known_however_it_is_written(written, listed):
    """With or without its maker, in upper or lower case, with blanks or hyphens."""
    assert listed in sheet(written).names


def test_what_is_in_no_list_is_none_and_has_names_near_it():
    """A name that only resembles another is not matched."""
    assert sheet("Leica AT96O") is None
    assert "Leica AT960" in near("Leica AT96O")
    assert sheet("Leica AT960X") is None
    assert near("coordinate arm of a mill") == []


def test_every_sheet_gives_what_it_prints():
    """A third of the square of a bound, or half of two sigma; its source states both values."""
    assert len([name for one in sheets() for name in one.names]) > 20
    vantage = sheet("FARO Vantage").noise
    assert vantage.range_m == pytest.approx(16e-6 / np.sqrt(3))
    assert vantage.transverse_per_m == pytest.approx(5e-6 / np.sqrt(3))
    assert sheet("Leica LTD500").noise.transverse_per_m == pytest.approx(5e-6)
    for one in sheets():
        assert all(f"{size:g} um" in one.source for size in (*one.along, *one.across) if size)


def made(**tables):
    """A small campaign, its campaign.toml with other lines in [tracker] and [instrument]."""
    polar = {"range_m": 5.8e-6, "transverse_m": 8.7e-6, "transverse_per_m": 3.5e-6}
    plan = revised(PLAN, {"tracker": {"noise": polar}})
    files = dict(simulate(plan, np.random.default_rng(3)).files)
    lines = files["campaign.toml"].decode().splitlines()
    lines = [line for line in lines if not line.startswith(("sigma_m", "noise"))]
    for table, more in tables.items():
        if f"[{table}]" not in lines:
            lines += [f"[{table}]"]
        at = lines.index(f"[{table}]")
        lines[at + 1 : at + 1] = more
    return in_memory(files | {"campaign.toml": "\n".join(lines).encode()})


MODEL = ['model = "Leica AT402"']


@pytest.mark.parametrize(
    ("tables", "source"),
    [
        ({"instrument": MODEL}, "sheet"),
        ({"instrument": MODEL, "tracker": ["sigma_m = 2e-5"]}, "stated"),
        (
            {
                "instrument": MODEL,
                "tracker": ["noise = { range_m = 1e-5, transverse_m = 2e-5 }"],
            },
            "instrument",
        ),
        ({"instrument": ['model = "Leica AT96O"']}, "none"),
        ({"instrument": [*MODEL, 'kind = "camera"']}, "none"),
        ({"instrument": [*MODEL, 'measures = "poses"']}, "none"),
        ({}, "none"),
    ],
)
def test_what_is_stated_comes_before_the_data_sheet(tables, source):
    """And a data sheet applies to a tracker that measures points."""
    readings = ingested(made(**tables)).readings

    assert set(readings["covariance_from"]) == {source}
    if source == "sheet":
        at = readings[["x_m", "y_m", "z_m"]].to_numpy()[0]
        C = covariance.matrices(readings)[0]
        reach = np.linalg.norm(at)
        assert at @ C @ at / reach**2 == pytest.approx((10e-6 / np.sqrt(3)) ** 2)
        side = np.cross(at, [0.1, -0.5, 0.9])
        side /= np.linalg.norm(side)
        assert side @ C @ side == pytest.approx(((15e-6 + 6e-6 * reach) / np.sqrt(3)) ** 2)


@pytest.mark.whole
def test_the_answer_says_where_the_noise_is_from():
    """From its data sheet, or that none is known, with similar names."""
    known = campaign_answer("known", made(instrument=MODEL)).answer
    assert "AT402" in known.instrument.data_sheet
    assert any("that of a data sheet: 5.77 um" in one for one in known.assumptions)
    assert str(known.fit.noise_from) == "stated"

    strange = campaign_answer("strange", made(instrument=['model = "Leica AT96O"'])).answer
    (said,) = [one for one in strange.findings if "data sheet" in one]
    assert "did you mean Leica AT960" in said
    assert strange.instrument.data_sheet is None
    assert str(strange.fit.noise_from) != "stated"


def test_three_variances_of_a_beam_get_their_correlations_back():
    """Software that writes one standard uncertainty per axis omits correlations."""
    position = np.array([[3.0, -4.0, 12.0], [5.0, 1.0, -2.0], [20.0, 1.0, 0.3], [2.0, 2.0, 1.9]])
    whole = beam_covariance(position, NOISE)

    found = correlated(position, whole[:, [0, 3, 5]])

    assert found == pytest.approx(whole, rel=1e-9, abs=1e-16)


@pytest.mark.parametrize(
    "variance", [[1e-10, 1e-10, 1e-10], [1e-10, 4e-10, 9e-10]], ids=["alike", "of axes"]
)
def test_variances_of_no_beam_have_no_correlations(variance):
    """One value for all axes, or three for fixed axes, do not reveal a beam."""
    rng = np.random.default_rng(3)

    assert correlated(rng.normal(size=(40, 3)), np.tile(variance, (40, 1))) is None


def test_readings_that_state_nothing_say_nothing_of_a_beam():
    """Zeros in the columns of an export: all, or some among those of a beam."""
    position = np.array([[3.0, -4.0, 12.0], [5.0, 1.0, -2.0], [20.0, 1.0, 0.3], [2.0, 2.0, 1.9]])
    whole = beam_covariance(position, NOISE)
    whole[:2] = 0.0

    assert correlated(position, np.zeros((4, 3))) is None
    assert correlated(position[:0], np.zeros((0, 3))) is None
    assert correlated(position, whole[:, [0, 3, 5]]) == pytest.approx(whole, rel=1e-9, abs=1e-16)


def test_a_reading_that_fits_no_beam_stays_uncorrelated():
    """One stated otherwise among readings of a beam, and one at the instrument itself."""
    position = np.array([[3.0, -4.0, 12.0], [5.0, 1.0, -2.0], [20.0, 1.0, 0.3], [0.0, 0.0, 0.0]])
    variance = beam_covariance(position, NOISE)[:, [0, 3, 5]]
    variance[0] = [1.0e-9, 1.5e-9, 1.0e-9]

    found = correlated(position, variance)

    assert found[[0, 3]][:, [1, 2, 4]] == pytest.approx(0)
    assert found[:, [0, 3, 5]] == pytest.approx(variance)


def test_a_direction_may_scatter_in_proportion_to_the_distance_alone():
    """An API Radian's 2.5 um/m has no constant part; no scatter at all is a slip."""
    noise = InstrumentNoise(range_m=0, range_per_m=2.5e-6, transverse_m=5e-6)
    along = beam_covariance(np.array([[4.0, 0.0, 0.0]]), noise)[0, 0]

    assert along == pytest.approx((4 * 2.5e-6) ** 2)
    with pytest.raises(ValueError, match="no scatter along the beam or across it"):
        InstrumentNoise(range_m=0, transverse_m=5e-6)
