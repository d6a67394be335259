"""Each load predicted from all others."""

from dataclasses import replace

import numpy as np
import pytest
from made_system import dense, generalised
from small_case import small

from pipeline.annex.validate import by_payload
from pipeline.reduction.bring import bring
from pipeline.reduction.weights import PULL
from pipeline.system.fit import fit


@pytest.fixture(scope="module")
def fitted():
    """Six poses, each pulled with 1500 and 3000 N; the settings name no payload."""
    case = small()
    found = fit(case, bring(case))
    return case.settings, found.data, found.system


def held_out(system, mine):
    """Rms [m] of these rows by generalised least squares of the others, on whole matrices."""
    V = dense(system)
    x, *_ = generalised(system.B[~mine], system.c[~mine], V[np.ix_(~mine, ~mine)])
    return np.sqrt(np.mean((system.c[mine] - system.B[mine] @ x) ** 2))


@pytest.mark.parametrize("first", [0, PULL])
def test_each_load_is_predicted_from_the_others(fitted, first):
    """The first pull of each pose with one load or by the chain, the second with another."""
    settings, data, system = fitted
    second = np.arange(len(data.pulls)) % 2 == 1
    body = np.where(second, 1, first)
    found = by_payload(settings, replace(data, body=body), system)

    kilograms = np.linalg.norm(data.pulls.force, axis=1) / settings.gravity.m_s2
    wanted = {f"{kilograms[1]:.6g} kg": held_out(system, body[system.rows.pull] == 1)}
    if first != PULL:
        wanted |= {f"{kilograms[0]:.6g} kg": held_out(system, body[system.rows.pull] == 0)}
    assert found == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("body", [0, PULL])
def test_one_load_has_no_others(fitted, body):
    settings, data, system = fitted

    assert by_payload(settings, replace(data, body=np.full(len(data.pulls), body)), system) == {}
