"""Parts of the searches in unloaded positions, each against least squares of whole matrices."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from pipeline.geometry.arm_weight import carried_by, usual
from pipeline.geometry.remastered import _in_time, places
from pipeline.geometry.roughness import _halved, _widths
from pipeline.geometry.slipped import ShapeRows, slips
from pipeline.machine.robot import load

RNG = np.random.default_rng(91)
P, S, TARGETS = 12, 5, 3


def residual(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What least squares of numpy leaves."""
    return y - X @ np.linalg.lstsq(X, y, rcond=None)[0]


def shape(y: np.ndarray, t: np.ndarray) -> ShapeRows:
    """Residuals about the mean shape, as `ShapeRows.of` has them."""
    flat = t.reshape(-1, t.shape[2])
    e = residual(flat, y.ravel()).reshape(y.shape)
    return ShapeRows(e, t, np.linalg.inv(flat.T @ flat), y.size - flat.shape[1])


def test_what_a_course_explains_is_the_drop_of_the_squares() -> None:
    """Of each target, with its three columns times the course beside those of the mean shape."""
    t, y = RNG.normal(size=(P, S, 3 * TARGETS)), RNG.normal(size=(P, S))
    share = np.stack([np.arange(P) >= 4.0, np.linspace(0, 1, P), np.eye(P)[7]])
    rows = shape(y, t)
    T, rank = rows.drops(share)

    X = t.reshape(-1, 3 * TARGETS)
    assert rows.square == pytest.approx(np.sum(residual(X, y.ravel()) ** 2))
    for c, course in enumerate(share):
        for k in range(TARGETS):
            more = (course[:, None, None] * t[:, :, 3 * k : 3 * k + 3]).reshape(-1, 3)
            left = residual(np.hstack([X, more]), y.ravel())
            assert T[c, k] == pytest.approx(rows.square - left @ left, rel=1e-9)
            assert rank[c, k] == 3


@pytest.mark.parametrize("turned", [False, True])
def test_a_step_is_found_behind_its_pose_in_the_order_of_time(turned: bool) -> None:
    """As the number of poses before it; another course, or noise alone, is no step."""
    t, noise = RNG.normal(size=(P, S, 3 * TARGETS)), 0.1 * RNG.normal(size=(P, S))
    order = np.arange(P)[::-1] if turned else RNG.permutation(P)
    late = np.argsort(order)
    moved = np.einsum("psa,a->ps", t[:, :, 3:6], [1.0, -2.0, 0.5])
    at, p = slips(shape(noise + moved * (late >= 5)[:, None], t), order, 2)

    assert at[1] == 5
    assert p[1] < 1e-6
    assert p[1] == p.min()
    for course in (late / P, late == 3):
        assert slips(shape(noise + moved * course[:, None], t), order, 2)[1].min() > 0.01
    assert slips(shape(noise, t), order, 2)[1].min() > 0.01


@pytest.mark.parametrize(("size", "moved"), [(0.1, 0.3), (3.0, 6.0)])
def test_the_chance_of_a_step_is_that_of_the_f_test(size: float, moved: float) -> None:
    """Its three columns against the scatter beside them, which is no less than the noise."""
    rng = np.random.default_rng(12)
    t, late = rng.normal(size=(P, S, 3 * TARGETS)), (np.arange(P) >= 6)[:, None, None]
    own = (late * t[:, :, :3]).reshape(-1, 3)
    y = size * rng.normal(size=P * S) + own @ [moved, -moved, moved]
    at, p = slips(shape(y.reshape(P, S), t), np.arange(P), 2)

    X = t.reshape(-1, 3 * TARGETS)
    less, more = residual(X, y), residual(np.hstack([X, own]), y)
    dof = P * S - 3 * TARGETS - 3
    scatter = max(1.0, more @ more / dof)
    ratio = (less @ less - more @ more) / 3 / scatter
    assert at[0] == 6
    assert p[0] == pytest.approx(stats.f.sf(ratio, 3, dof), rel=1e-6)


def test_widths_of_nodes_are_those_of_the_trapezoidal_rule() -> None:
    """An integral over the logarithm of any function linear between the nodes."""
    nodes = np.array([0.01, 0.03, 0.1, 1.0, 7.0])
    density = RNG.normal(size=5)

    by_hand = np.sum(np.diff(np.log(nodes)) * (density[1:] + density[:-1]) / 2)
    assert _widths(nodes).sum() == pytest.approx(np.log(700))
    assert _widths(nodes) @ density == pytest.approx(by_hand)


def test_a_grid_is_refined_where_the_density_changes() -> None:
    """By the geometric middle of each steep interval and those beside it; no weight, no node."""
    nodes = 10.0 ** np.arange(-3.0, 4.0)
    density = np.array([-50.0, -50, -50, -50, 0, -0.1, -0.2])
    found = _halved(nodes, density)

    middle = np.sqrt(nodes[3] * nodes[4])
    assert found == pytest.approx(
        [nodes[3], middle, nodes[4], np.sqrt(nodes[4] * nodes[5]), *nodes[5:]]
    )
    flat = _halved(nodes, np.zeros(7))
    assert flat == pytest.approx(nodes)


def test_time_orders_poses_and_numbers_do_where_it_is_not_known() -> None:
    """Poses by the clock of their zeros; one unknown time leaves the numbers."""
    pulls = SimpleNamespace(pose=np.array([5, 5, 9, 7]), time_zero=np.array([30.0, 30, 10, 20]))
    zeros = SimpleNamespace(pose=np.array([0, 0, 2, 1]), pulls=pulls, poses=3)
    assert _in_time(zeros).tolist() == [2, 1, 0]
    pulls.time_zero[2] = np.nan
    assert _in_time(zeros).tolist() == [0, 1, 2]
    assert [places(SimpleNamespace(poses=n)) for n in (2, 4, 10)] == [1, 1, 7]


def test_a_screw_is_turned_by_the_links_behind_it_only() -> None:
    """Work of each link's unit wrenches on screws, zero for links before their carrier."""
    screws, unit = RNG.normal(size=(4, 3, 6)), RNG.normal(size=(4, 5, 4, 6))
    carrier = np.array([1, 3, 6])
    found = carried_by(screws, carrier, unit).reshape(4, 3, 5, 4)

    for v, first in enumerate(carrier):
        for link in range(1, 6):
            own = np.einsum("mi,mki->mk", screws[:, v], unit[:, link - 1])
            np.testing.assert_allclose(found[:, v, link - 1], own * (link >= first), atol=1e-12)


def test_an_arm_weighs_five_times_its_payload_or_as_its_file_states() -> None:
    """Each link centred between its axes; half of the payload may hang at the flange."""
    bare, stated = load("kr500_rail"), load("ur10")
    for robot in (bare, stated):
        mean, std = usual(robot)
        assert (std > 0).all()
        assert std[-1, 0] >= 0.5 * robot.payload_kg
    mean, _ = usual(bare)
    assert mean[:, 0].sum() == pytest.approx(5 * bare.payload_kg)
    ends = np.array([*(step[:3, 3] for step in bare.placement[1:]), bare.flange[:3, 3]])
    np.testing.assert_allclose(mean[:, 1:], mean[:, :1] * ends / 2)
    masses = [joint.mass_kg or 0.0 for joint in stated.joints]
    assert usual(stated)[0][:, 0] == pytest.approx(masses)
