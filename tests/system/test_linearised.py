"""A linearised campaign: against differences of the forward model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.machine.cell import load, paper_cell, predict
from pipeline.machine.effects import catalogue
from pipeline.reduction.effector import tool
from pipeline.store.campaign import in_memory
from pipeline.system.linearised import CurrentModel, accepted_columns, linearise, owners

NAMES = ("rail_roll", "compensator", "scale_zero", "joint_hardening:3", "base_rotation")
"""Suspects that are elastic, of two parameters, at the force, in a gear and at the instrument."""


@pytest.fixture(scope="module")
def measured(small_campaign, read_back):
    """A small campaign's measurements, the paper's cell and some suspects."""
    raw = in_memory(small_campaign.files)
    every = {}
    for effect in catalogue(raw.robot):
        every.setdefault(effect.label, effect)
    cell = paper_cell(raw.robot, tool(raw.settings))
    return read_back(small_campaign).data, cell, tuple(every[name] for name in NAMES)


def modelled(cell, suspects, accepted=()):
    """Springs and some suspects, these accepted at a third of their typical size."""
    values = cell.robot.nominal_compliance * np.linspace(0.8, 1.2, 7)
    mine = [suspects[i] for i in accepted]
    more = [p.typical / 3 for effect in mine for p in effect.parameters]
    return CurrentModel(cell.with_effects(*mine), np.append(values, more), 7, accepted)


def displaced(cell, data, values):
    """Displacements of a cell in the order of the rows [m]."""
    return predict(cell, data.pulls, values).displacement[data.pull, data.target].ravel()


def slope(cell, data, values, index):
    """Derivative by one parameter, from a difference of a hundredth of its typical size."""
    step = np.zeros(len(values))
    step[index] = 0.01 * cell.parameters[index].typical
    ahead, behind = (displaced(cell, data, values + s) for s in (step, -step))
    return (ahead - behind) / (2 * step[index])


def like(columns, truth):
    """Whether columns agree to 1e-4 of their length."""
    apart = np.linalg.norm(columns - truth, axis=0)
    return bool((apart <= 1e-4 * np.linalg.norm(truth, axis=0)).all())


@pytest.mark.parametrize("accepted", [(), (3,), (2, 1)])
def test_columns_are_slopes_of_the_model_where_it_stands(measured, accepted):
    """Springs and suspects: accepted ones at their values, the others at zero."""
    data, cell, suspects = measured
    model = modelled(cell, suspects, accepted)
    seen = linearise(model, data, suspects)
    springs = [slope(model.cell, data, model.values, k) for k in range(7)]
    column = 0

    assert like(seen.B, np.column_stack(springs))
    for i, effect in enumerate(suspects):
        for k in range(len(effect.parameters)):
            if i in accepted:
                before = sum(len(suspects[j].parameters) for j in accepted[: accepted.index(i)])
                truth = slope(model.cell, data, model.values, 7 + before + k)
            else:
                more = np.append(model.values, np.zeros(len(effect.parameters)))
                wide = model.cell.with_effects(effect)
                truth = slope(wide, data, more, len(model.values) + k)
            assert like(seen.Z[:, [column]], truth[:, None]), effect.label
            column += 1
    assert column == seen.Z.shape[1] == 8


@pytest.mark.parametrize("accepted", [(), (3,), (2, 1)])
def test_rows_are_what_the_model_misses_and_what_its_columns_make_of_its_values(measured, accepted):
    """Y - B x0 - Z z0 is the measured minus the predicted displacement, for any model."""
    data, cell, suspects = measured
    model = modelled(cell, suspects, accepted)
    seen = linearise(model, data, suspects)
    x, z = model.values[:7], np.zeros(8)
    for column, index in accepted_columns(model, suspects):
        z[column] = model.values[index]

    missed = data.delta.ravel() - displaced(model.cell, data, model.values)
    assert seen.y - seen.B @ x - seen.Z @ z == pytest.approx(missed, abs=1e-12)


def test_parameters_of_accepted_suspects_follow_the_springs_in_the_order_of_acceptance(measured):
    """Columns are in the order of suspects, indices in that of acceptance.

    Two for the compensator.
    """
    *_, cell, suspects = measured
    model = modelled(cell, suspects, (4, 1))

    assert owners(suspects).tolist() == [0, 1, 1, 2, 3, 4, 4, 4]
    assert accepted_columns(model, suspects) == [(5, 7), (6, 8), (7, 9), (1, 10), (2, 11)]


def test_motions_are_those_of_a_rigid_effector(measured):
    """Translations along, then rotations about, the axes of F_b, at the mean of the reflectors."""
    data, cell, suspects = measured
    model = modelled(cell, suspects)
    seen = linearise(model, data, suspects)
    points = load(model.cell, data.pulls, model.values).points
    about = points - points.mean(axis=1, keepdims=True)

    for axis in range(3):
        shift = np.broadcast_to(np.eye(3)[axis], points.shape)
        assert seen.motions[:, axis] == pytest.approx(shift[data.pull, data.target].ravel())
        turn = Rotation.from_rotvec(1e-6 * np.eye(3)[axis])
        moved = (turn.apply(about.reshape(-1, 3)).reshape(about.shape) - about) / 1e-6
        truth = moved[data.pull, data.target].ravel()
        assert seen.motions[:, 3 + axis] == pytest.approx(truth, abs=1e-6)


def test_further_suspects_stand_behind_those_that_are_there(measured):
    """The same as if all had been included from the start."""
    data, cell, suspects = measured
    model = modelled(cell, suspects, (1,))
    some = linearise(model, data, suspects[:3]).beside(suspects[3:])
    every = linearise(model, data, suspects)

    assert some.suspects == every.suspects
    assert pytest.approx(every.Z) == some.Z
    assert some.y == pytest.approx(every.y)
    bent = linearise(model, data, suspects[:3]).bent("deformed").beside(suspects[3:])
    assert pytest.approx(every.Z, rel=1e-12) == bent.Z


def test_the_robots_own_deflection_is_taken_from_the_rows_once(measured):
    """Deflected, it is the campaign linearised at the deflected robot.

    Reversed, it is the first.
    """
    data, cell, suspects = measured
    straight = linearise(modelled(cell, suspects), data, suspects)
    bent = straight.bent("deformed")
    deformed = replace(straight.model, cell=replace(straight.model.cell, equilibrium="deformed"))
    anew = linearise(deformed, data, suspects)
    second_order = displaced(deformed.cell, data, deformed.values) - displaced(
        cell, data, deformed.values
    )

    assert bent.model.cell.equilibrium == "deformed"
    assert bent.y == pytest.approx(anew.y, abs=1e-13)
    assert straight.y - bent.y == pytest.approx(second_order, abs=1e-13)
    assert np.abs(second_order).max() > 1e-6
    assert bent.bent("undeformed").y == pytest.approx(straight.y, abs=1e-13)


@pytest.mark.parametrize("accepted", [(), (3,), (0, 1, 2, 3, 4)])
def test_a_campaign_linearised_nearby_lends_errors_and_nothing_else(measured, accepted):
    """Columns and rows are those of the model itself; errors are those of the nearby model."""
    data, cell, suspects = measured
    near = linearise(modelled(cell, suspects), data, suspects)
    model = modelled(cell, suspects, accepted)
    seen, alone = linearise(model, data, suspects, near), linearise(model, data, suspects)

    assert seen.errors is near.errors
    for name in ("B", "Z", "y", "motions"):
        assert getattr(seen, name) == pytest.approx(getattr(alone, name), rel=1e-9)


def test_the_springs_alone_are_a_system(measured):
    """Without the accepted cause, with the noise stated in the measurements."""
    data, cell, suspects = measured
    data = replace(data, noise_stated=False, found_m=2e-5)
    system = linearise(modelled(cell, suspects, (1,)), data, suspects).system

    assert system.parameters == cell.parameters
    assert system.B.shape == (len(system.c), 7)
    assert (system.noise_stated, system.found_m) == (False, 2e-5)
