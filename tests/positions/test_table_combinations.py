"""Combinations of DH parameters that are determined; chain of test_unloaded."""

from types import SimpleNamespace

import numpy as np
import pytest
from rail_chain import LETTERS, stands

from pipeline.annex.sections.geometry import dh_table
from pipeline.positions import table_entries
from tests.geometry.test_unloaded import estimated, of, poses, read

ROUGH_M = 5e-4


def told(seed):
    """Parameters and combinations of a robot with DH errors throughout, and the true errors."""
    rng = np.random.default_rng(seed)
    wrong = {letter.label: ROUGH_M * float(rng.standard_normal()) for letter in LETTERS}
    found, _ = estimated(of(read(seed, wrong, joints=1e-4)))
    stood = SimpleNamespace(cells=found, causes=())
    return *table_entries.estimated(stood), wrong


def label(entry):
    return f"{entry.name}:{entry.where}"


def test_offsets_along_parallel_axes_are_known_by_their_sum():
    """The chain shows why: increasing one offset and decreasing the other has no effect."""
    there, back = (stands(poses(), {"link_offset:3": s, "link_offset:4": -s}) for s in (0, 1e-3))
    np.testing.assert_allclose(there, back, atol=1e-12)

    entries, combinations, _ = told(1)

    known = {label(entry): entry.identifiable for entry in entries}
    assert not known["link_offset:3"]
    assert not known["link_offset:4"]
    (both,) = [one for one in combinations if "link_offset:3" in map(label, one.of)]
    assert [(label(one), one.weight) for one in both.of] == [
        ("link_offset:3", pytest.approx(1.0, abs=1e-6)),
        ("link_offset:4", pytest.approx(1.0, abs=1e-6)),
    ]
    (single,) = {entry.std for entry in entries if label(entry) == "link_offset:3"}
    assert both.std < single


def test_what_places_the_robot_is_in_no_combination():
    """The position of the first axis is F_b's, of the last one the tool's: not determined."""
    for seed in range(3):
        _, combinations, _ = told(seed)
        members = {label(entry) for one in combinations for entry in one.of}
        assert not members & {"link_length:2", "link_offset:2", "link_offset:7", "joint_offset:7"}


@pytest.mark.whole
def test_combinations_are_off_by_what_is_stated():
    """Twenty robots, every combination, against the true errors of its parameters."""
    pulls = []
    for seed in range(20):
        _, combinations, wrong = told(100 + seed)
        for one in combinations:
            truth = sum(entry.weight * wrong[label(entry)] for entry in one.of)
            pulls.append((one.value - truth) / one.std)
            assert (one.ci95[0] < truth < one.ci95[1]) == (abs(pulls[-1]) < 1.959964)
    assert len(pulls) >= 10
    assert np.std(pulls) == pytest.approx(1.0, abs=0.3)


def test_the_report_says_the_sum():
    entries, combinations, _ = told(1)
    section = dh_table(SimpleNamespace(geometry=entries, geometry_combinations=combinations), {})

    table = next(block for block in section.blocks if block.name == "letter_combinations")
    assert table.rows[0][0].text == "offset 3 + offset 4"
