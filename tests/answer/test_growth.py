"""An 18 m rail expands by 0.2 mm per kelvin, and the base frame with it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from small_case import small

from pipeline.answer.inputs import registration_entry
from pipeline.base.errors import InputError
from pipeline.check.findings import growth_findings
from pipeline.reduction.growth import BaseGrowth
from pipeline.reduction.register import XYZ, place, register
from pipeline.reduction.settings import parse

WARM_C, PER_KELVIN = 26.0, 11.5e-6
"""Temperature of a hall in summer [degC], and expansion of steel per kelvin from tables."""


@pytest.fixture(scope="module")
def case():
    """Six poses on the rail, four base reflectors, at 20 degC."""
    return small(3)


def warm(case, by_k=WARM_C - 20):
    """Readings of the campaign with everything longer."""
    rows = case.readings
    grown = {axis: rows[axis] * (1 + PER_KELVIN * by_k) for axis in XYZ}
    return replace(case, readings=rows.assign(**grown))


def stated(case, temperature_c):
    """With a temperature in campaign.toml."""
    settings = case.settings.model_copy(update={"temperature_c": temperature_c})
    return replace(case, settings=settings)


def placed(case):
    """Readings of the poses in F_b [m]."""
    found = register(case.settings, case.readings)
    return found, place(found, case.readings)[XYZ].to_numpy()


def test_a_warm_campaign_is_that_of_20_degrees(case):
    """With its temperature: the same positions in F_b to micrometres, instead of 0.6 mm."""
    cold, at = placed(case)
    found, now = placed(stated(warm(case), WARM_C))
    _, without = placed(replace(warm(case), settings=case.settings))

    assert np.abs(now - at).max() < 2e-5
    assert found.growth.value == pytest.approx(6.9e-5, abs=3e-6)
    assert 0 < found.growth.std < 5e-6
    assert found.chi2 == pytest.approx(cold.chi2, rel=0.3)
    assert not found.from_scatter
    assert found.dof == cold.dof - 1
    assert growth_findings(registration_entry(found)) == []
    assert np.abs(without - at).max() < 2e-5  # the reflectors show it, too


def test_reflectors_that_grew_say_so_without_a_thermometer(case):
    """From half a kelvin on, with a message."""
    for by_k in (-8, 0.7, 6):
        found, _ = placed(warm(case, by_k))
        assert found.growth.value == pytest.approx(PER_KELVIN * by_k, abs=4e-6)
        assert found.growth.probability > 0.9
        assert not found.from_scatter
    (told,) = growth_findings(registration_entry(found))
    assert "state temperature_c" in told
    assert "as steel at 26.0 °C" in told or "as steel at 25.9 °C" in told


@pytest.mark.parametrize("seen", [7e-5, None])
def test_each_number_of_a_growth_is_its_own(seen):
    """Value, expected, seen, each with its uncertainty; nothing where nothing has grown."""
    grown = BaseGrowth(1e-5, 2e-5, 3e-5, 4e-5, seen, 8e-5, 0.9)
    base = SimpleNamespace(
        table=pd.DataFrame({"dx_m": [1e-5], "dy_m": [2e-5], "dz_m": [2e-5]}),
        cov=np.diag(np.arange(1.0, 7.0) ** 2), chi2=3.0, dof=3, growth=grown,
    )  # fmt: skip
    said = registration_entry(base)

    told = said.growth.model_dump()
    assert told.pop("seen_std") == (None if seen is None else 8e-5)
    assert told == {name: getattr(grown, name) for name in told}
    assert said.rotation_std_rad == (1.0, 2.0, 3.0)
    assert said.translation_std_m == (4.0, 5.0, 6.0)
    assert said.max_mm == pytest.approx(0.03)
    assert said.p_value == pytest.approx(0.3916, abs=1e-4)  # tables of chi-square


def test_no_growth_is_seen_where_there_is_none(case):
    """Nothing changes, to the last digit: neither in good data nor with a displaced reflector."""
    good = register(case.settings, case.readings)
    rows = case.readings
    knocked = (rows["target"] == "B2") & rows["pose"].isna()
    for off in (5e-4, 5e-3, 0.05):
        bad = rows.assign(x_m=np.where(knocked, rows["x_m"] + off, rows["x_m"]))
        found = register(case.settings, bad)
        assert found.growth.value == 0
        assert found.from_scatter

    assert (good.growth.value, good.growth.std, good.dof) == (0, 0, 3 * len(good.table) - 6)
    assert registration_entry(good).growth is None


def test_the_reflectors_are_believed_against_the_thermometer(case):
    """An export that was already compensated: its scale, and a sentence."""
    found, now = placed(stated(case, WARM_C))
    _, at = placed(case)

    assert np.abs(now - at).max() < 3e-5
    (told,) = growth_findings(registration_entry(found))
    assert "compensated already" in told


def test_the_thermometer_is_believed_where_reflectors_disagree(case):
    """A reflector off by 50 mm says nothing about a length; the expected value is kept."""
    hot = stated(warm(case), WARM_C)
    rows = hot.readings
    knocked = (rows["target"] == "B2") & rows["pose"].isna()
    bad = rows.assign(y_m=np.where(knocked, rows["y_m"] + 0.05, rows["y_m"]))
    found = register(hot.settings, bad)

    assert found.growth.value == pytest.approx(6.9e-5, abs=1.3e-5)
    assert found.growth.std == pytest.approx(1.2e-5, rel=0.1)


def test_noise_that_nobody_states_does_not_matter(case):
    """The scatter of the reflectors determines their weight against the thermometer."""
    none = {name: np.nan for name in case.readings if name.startswith("c") and name.endswith("m2")}
    hot = stated(warm(case), WARM_C)
    found = register(hot.settings, pd.DataFrame(hot.readings.assign(**none)))

    assert found.growth.value == pytest.approx(6.9e-5, abs=3e-6)


@pytest.mark.parametrize("temperature", ["295", '"warm"', "nan"])
def test_a_temperature_that_no_hall_has_is_refused(temperature):
    """Kelvins or words: with the line."""
    text = f'format = 1\nname = "a"\nrobot = "kr500_rail"\ntemperature_c = {temperature}\n'

    with pytest.raises(InputError, match=r"campaign\.toml:4: temperature_c"):
        parse(text)
