"""A wander of the instrument: simulated with numpy, its likelihood compared with dense algebra."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.system import wander as module
from pipeline.system.blocks import Blocks
from pipeline.system.rows_by_pose import RowsByPose
from pipeline.system.wander import TIMES_S, Wander, kernel, wander
from pipeline.system.whiten import Whitener

POSES, PULLS, TARGETS = 16, 4, 3
SIGMA_M = 3e-5


def walk(times, tau, rng):
    """An Ornstein-Uhlenbeck process of unit variance at sorted times, step by step."""
    w = [rng.standard_normal(3)]
    for step in np.diff(times):
        keep = np.exp(-step / tau)
        w.append(keep * w[-1] + np.sqrt(1 - keep**2) * rng.standard_normal(3))
    return np.array(w)


def timetable():
    """Zeros before and after four pulls of each pose [s]."""
    start = 600.0 * np.arange(POSES)
    pulls = start[:, None] + 90.0 * np.arange(1, PULLS + 1)
    zeros = start[:, None] + [0.0, 90.0 * (PULLS + 1)]
    return pulls, zeros


def measured():
    pulls, zeros = timetable()
    pose = np.repeat(np.arange(POSES), PULLS)
    d = POSES * PULLS * TARGETS
    return SimpleNamespace(
        pulls=SimpleNamespace(pose=pose, time=pulls.ravel(), __len__=lambda: len(pose)),
        zero_times=zeros[pose],
        pull=np.repeat(np.arange(len(pose)), TARGETS),
        shifts=np.ones(d, dtype=bool),
        tracker=None,
        unloaded=np.zeros((d, 3)),
        loaded_cov=np.tile(SIGMA_M**2 * np.eye(3), (d, 1, 1)),
    )


def beyond_of(y):
    """Whitened rows of noise in the complement of three columns."""
    X = np.linalg.qr(np.random.default_rng(0).standard_normal((len(y), 3)))[0]
    pose = np.repeat(np.arange(POSES), PULLS * TARGETS * 3)
    blocks = Blocks.of(pose)
    inverse = np.tile(np.eye(blocks.shape[1]) / SIGMA_M, (POSES, 1, 1))
    return RowsByPose(Whitener(blocks, inverse, np.zeros((len(y), 0))), X, np.zeros(3), y)


def drawn(size, tau, rng, axes=(1.0, 1.0, 1.0)):
    """Whitened rows of a campaign with a wander of some standard uncertainties."""
    pulls, zeros = timetable()
    times = np.sort(np.concatenate([pulls.ravel(), zeros.ravel()]))
    w = dict(zip(times.tolist(), size * walk(times, tau, rng) * axes, strict=True))
    moved = np.array(
        [
            w[t] - (w[zeros[p, 0]] + w[zeros[p, 1]]) / 2
            for p in range(POSES)
            for t in pulls[p].tolist()
        ]
    )
    rows = np.repeat(moved, TARGETS, axis=0) + rng.standard_normal((POSES * PULLS * TARGETS, 3))
    return rows.ravel()


def test_the_kernel_is_the_covariance_of_what_walks():
    """Ten thousand walks through one pose."""
    pulls, zeros = timetable()
    t, z = pulls[0], zeros[0]
    times, rng = np.sort(np.concatenate([t, z])), np.random.default_rng(1)
    factor, mean = kernel(measured(), 1200.0)
    K = factor[:PULLS] @ factor[:PULLS].T * mean
    walked = np.array([walk(times, 1200.0, rng)[:, 0] for _ in range(10_000)])
    at = np.searchsorted(times, t), np.searchsorted(times, z)
    moved = walked[:, at[0]] - walked[:, at[1]].mean(axis=1, keepdims=True)

    assert np.cov(moved.T) == pytest.approx(K, abs=5 * K.max() * np.sqrt(2 / 10_000))
    assert np.mean(np.sum(factor**2, axis=1)) == pytest.approx(1.0)


def test_the_likelihood_is_that_of_dense_algebra():
    """log|V| + log|X'V^-1 X| + r'V^-1 r with the whole V, for three sizes."""
    data, rng = measured(), np.random.default_rng(2)
    y = drawn(1.0, 1200.0, rng)
    beyond = beyond_of(y)
    alike = np.tile(np.eye(3), (len(data.pull), 1, 1))
    factor = SIGMA_M * module._shifted(data, alike, kernel(data, 1200.0)[0])
    sizes = np.array([0.0, 0.6, 3.0])
    got = module._losses(beyond, factor, sizes)
    pose = np.repeat(np.arange(POSES), PULLS * TARGETS * 3)
    flat = factor.reshape(len(y), -1) / SIGMA_M
    K = flat @ flat.T * (pose[:, None] == pose)
    out = []
    for a in sizes:
        V = np.eye(len(y)) + a**2 * K
        solved = np.linalg.solve(V, np.column_stack([beyond.X, y]))
        N, g = beyond.X.T @ solved[:, :-1], beyond.X.T @ solved[:, -1]
        rest = y @ solved[:, -1] - g @ np.linalg.solve(N, g)
        out.append(np.linalg.slogdet(V)[1] + np.linalg.slogdet(N)[1] + rest)

    assert got - got[0] == pytest.approx(np.array(out) - out[0], rel=1e-8, abs=1e-6)


@pytest.mark.whole
def test_a_wander_is_found_and_white_noise_has_none():
    """One standard uncertainty over ten minutes; its size is found."""
    data = measured()
    found = [
        wander(data, beyond_of(drawn(1.0, 600.0, np.random.default_rng(k)))) for k in range(10)
    ]
    factor = kernel(data, 600.0)[1]
    none = [wander(data, beyond_of(drawn(0.0, 600.0, np.random.default_rng(k)))) for k in range(10)]

    assert sum(one.p_value < 0.003 for one in found) >= 9
    assert np.median([one.size for one in found]) == pytest.approx(
        SIGMA_M * np.sqrt(factor), rel=0.25
    )
    assert sum(one.p_value < 0.003 for one in none) == 0
    assert np.median([one.size for one in none]) < 0.15 * SIGMA_M


def test_between_two_times_it_is_that_of_the_process():
    """Exponentials at the trial correlation times, each with its variance."""
    process = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.5]])
    one = Wander(np.zeros((1, 3, 1)), 0.0, 0.0, TIMES_S[0], 1.0, 0.0, process, SIGMA_M)
    levers = np.array([[2.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    F = one.of_readings(np.array([0.0, 1200.0]), levers).reshape(6, -1)

    shift = sum(v * np.exp(-1200.0 / t) for v, t in zip(process[0], TIMES_S, strict=True))
    turn = 0.5 * np.exp(-1200.0 / TIMES_S[2])
    own = np.diag([6.0, 6.0 + 0.5 * 4.0, 6.0 + 0.5 * 4.0])  # a lever along x moves y and z
    other = np.array([[shift, 0.0, 0.0], [-turn * 8.0, shift, 0.0], [0.0, 0.0, shift]])
    assert (F @ F.T)[:3, :3] == pytest.approx(own)
    assert (F @ F.T)[:3, 3:] == pytest.approx(other)


def turning(size, tau, rng):
    """Targets 4 to 20 m from an instrument that turns by `size` SIGMA_M at 10 m: data, rows."""
    data = measured()
    at = np.repeat(rng.uniform([3.0, -9.0, -1.0], [18.0, 9.0, 1.0], (POSES, 3)), PULLS, axis=0)
    data.unloaded = np.repeat(at, TARGETS, axis=0) + rng.uniform(-0.2, 0.2, (len(data.pull), 3))
    data.tracker = np.zeros(3)
    still = np.random.default_rng(int(rng.integers(1 << 30)))
    rows = drawn(0.0, tau, still).reshape(-1, 3)
    pulls, zeros = timetable()
    times = np.sort(np.concatenate([pulls.ravel(), zeros.ravel()]))
    w = dict(zip(times.tolist(), size / 10.0 * walk(times, tau, rng), strict=True))
    turns = np.array(
        [w[t] - (w[zeros[p, 0]] + w[zeros[p, 1]]) / 2 for p in range(POSES) for t in pulls[p]]
    )
    moved = np.cross(np.repeat(turns, TARGETS, axis=0), data.unloaded)
    return data, (rows + moved).ravel(), moved


def test_an_instrument_that_turns_moves_what_is_far_from_it():
    """Its size is found, its covariance increases with range, and no shift is found instead."""
    found = [turning(2.0, 600.0, np.random.default_rng(k)) for k in range(3)]
    told = [wander(data, beyond_of(rows)) for data, rows, _ in found]

    assert all(one.p_value < 0.003 for one in told)
    for one, (data, _, moved) in zip(told, found, strict=True):
        std = np.sqrt(np.sum(one.factor**2, axis=2)) / SIGMA_M
        assert one.process[1].sum() > 0.0
        size = one.size / SIGMA_M
        assert size == pytest.approx(np.sqrt(np.mean(moved**2)), rel=0.5)
        near = np.linalg.norm(data.unloaded, axis=1) < 8.0
        assert np.mean(std[near]) < 0.7 * np.mean(std[~near])


def test_without_times_nothing_wanders():
    """The rows of a wander that would be found, without the times of the pulls."""
    data, rows = measured(), drawn(1.0, 600.0, np.random.default_rng(0))
    assert wander(data, beyond_of(rows)).size > 0.0
    data.pulls.time = np.full(POSES * PULLS, np.nan)

    assert wander(data, beyond_of(rows)).size == 0.0


@pytest.mark.whole
def test_one_axis_alone_is_told_from_three():
    """The same walk along y only, and in all three axes: only the latter is the instrument's."""
    data, rng = measured(), np.random.default_rng
    alone = wander(data, beyond_of(drawn(3.0, 600.0, rng(3), (0.0, 1.0, 0.0))))
    together = wander(data, beyond_of(drawn(3.0, 600.0, rng(3))))

    two = wander(data, beyond_of(drawn(3.0, 600.0, rng(3), (1.0, 0.0, 1.0))))

    assert (alone.size, alone.p_value) == (0.0, 1.0)
    assert together.p_value < 1e-6
    assert two.p_value < 1e-6  # the wander of an instrument may differ between axes


def test_sizes_of_their_own_belong_to_the_axes():
    """A factor with columns ordered by axis is scaled axis by axis, whatever its rank."""
    data, y = measured(), drawn(3.0, 600.0, np.random.default_rng(3), (0.0, 1.0, 0.0))
    alike = np.tile(np.eye(3), (len(data.pull), 1, 1))
    factor = module._shifted(data, alike, kernel(data, 600.0)[0])

    for axis in range(3):
        part = factor[:, :, axis * (factor.shape[2] // 3) : (axis + 1) * (factor.shape[2] // 3)]
        assert np.abs(np.delete(part, axis, axis=1)).max() == 0.0
    assert module._along_one_axis(beyond_of(y), SIGMA_M * factor, 1.8)


def sprung(rng):
    """Effect of seven joints on the rows [m].

    By the force of a pull, nearly equal for all targets.
    """
    size = np.tile([0.35, 0.7, 1.0, 0.5], POSES)[:, None, None]
    of_pull = size * np.exp(rng.normal(0, 1, (POSES, 1, 7))).repeat(PULLS, axis=0)
    way = rng.standard_normal((POSES, 3, 7)).repeat(PULLS, axis=0)
    rows = np.repeat(of_pull * way, TARGETS, axis=0).reshape(-1, 7)
    return 1e-3 * (rows + 0.05 * rng.standard_normal(rows.shape))


def softened(part, tau, moves, rng):
    """Whitened rows of joints whose compliances wander by a relative amount."""
    pulls = timetable()[0].ravel()
    changes = np.hstack([walk(pulls, tau, rng) for _ in range(3)])[:, :7]
    rows = np.sum(moves * np.repeat(changes, TARGETS * 3, axis=0), axis=1)
    return part * rows / SIGMA_M + rng.standard_normal(len(rows))


@pytest.mark.slow
def test_joints_that_soften_are_told_from_an_instrument():
    """Both move all targets alike and slowly; the joints through torques, the wander without."""
    data, blind = measured(), []
    for k in range(5):
        moves = sprung(np.random.default_rng(k))
        joints = beyond_of(softened(0.03, 1200.0, moves, np.random.default_rng(100 + k)))
        tracker = beyond_of(drawn(1.5, 1200.0, np.random.default_rng(k)))
        blind.append(wander(data, joints).p_value < 0.003)

        assert wander(data, joints, moves=moves).probability < 0.01
        assert wander(data, joints, moves=moves).size < 0.1 * SIGMA_M
        alone = wander(data, tracker).size
        assert wander(data, tracker, moves=moves).size == pytest.approx(alone, rel=1e-3)
        assert alone > 0.0
    assert any(blind)


def test_where_joints_explain_it_as_well_the_wander_keeps_its_share(monkeypatch):
    """With equal likelihoods: four to one, the odds of an unnamed cause; never zero."""
    data, rows = measured(), beyond_of(drawn(1.5, 1200.0, np.random.default_rng(1)))
    alike = np.append(100.0, np.zeros(len(module.SIZES)))
    monkeypatch.setattr(module, "_losses", lambda beyond, factor, sizes: alike[-len(sizes) :])
    monkeypatch.setattr(module, "_along_one_axis", lambda *_: False)

    alone, beside = wander(data, rows), wander(data, rows, moves=sprung(np.random.default_rng(1)))

    assert alone.probability == pytest.approx(1.0)
    assert beside.probability == pytest.approx(0.8)
    assert beside.size**2 == pytest.approx(0.8 * alone.size**2)


@pytest.mark.slow
def test_restless_joints_are_what_is_drawn_of_them():
    """Their covariance within a pose, in the mean square of all rows, is that of 3000 walks."""
    data, moves, rng = measured(), sprung(np.random.default_rng(1)), np.random.default_rng(2)
    factor = module.restless(data, moves, 1200.0).reshape(len(moves), -1)
    rows = np.arange(PULLS * TARGETS * 3)
    walked = np.array([softened(1.0, 1200.0, moves, rng)[rows] * SIGMA_M for _ in range(3000)])
    K = np.cov(walked.T)

    assert np.mean(np.sum(factor**2, axis=1)) == pytest.approx(1.0)
    mine = factor[rows] @ factor[rows].T
    K, mine = K / np.trace(K), mine / np.trace(mine)
    assert mine == pytest.approx(K, abs=0.1 * K.max())


@pytest.mark.parametrize("counts", [(7, 3, 7, 5), (80, 3, 3, 5)])
def test_rotated_rows_have_the_covariance_of_the_factor(counts):
    """log|I + A A'| and y' (I + A A')^-1 X of the whole matrix, also with one crowded pose."""
    rng = np.random.default_rng(4)
    pose = rng.permutation(np.repeat(np.arange(len(counts)), counts))
    y, X, A = (rng.standard_normal((len(pose), k)) for k in (1, 3, 4))
    blocks = Blocks.of(pose)
    inverse = np.tile(2.0 * np.eye(blocks.shape[1]), (len(counts), 1, 1))
    white = Whitener(blocks, inverse, np.zeros((len(pose), 0)))
    w, turned, Z = RowsByPose(white, X, np.zeros(3), y[:, 0]).rotated(A)
    V = np.eye(len(pose)) + 4.0 * (A @ A.T) * (pose[:, None] == pose)

    assert np.log(1 + w).sum() == pytest.approx(np.linalg.slogdet(V)[1])
    assert (turned / (1 + w)) @ Z == pytest.approx(y[:, 0] @ np.linalg.solve(V, X))
