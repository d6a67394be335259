"""False alarms after a long pause without campaigns."""

import numpy as np
import pytest

from pipeline.fleet.wear.alarm import A_YEAR, interim_tests
from pipeline.fleet.wear.machine import Machine, Visit
from pipeline.fleet.wear.scatter import scatter

NEW = np.array([2e-7, 1.5e-7, 2.5e-7])


@pytest.mark.parametrize("pause", [0.5, 1.0, 6.0])
def test_a_look_spends_no_more_than_a_year_however_long_the_pause_was(pause):
    """1 % times the years since the previous test, one year at most (docs/fleet.md)."""
    cov = np.diag((0.005 * NEW) ** 2)
    years = [2000.0, 2000.4, 2000.8, 2000.8 + pause]
    machine = Machine.of("", [Visit(f"c{k}", year, NEW, cov) for k, year in enumerate(years)])

    spent = [look.allowed for look in interim_tests(machine, scatter([machine]))]

    assert spent == pytest.approx([0.4 * A_YEAR, 0.4 * A_YEAR, min(pause, 1.0) * A_YEAR])
