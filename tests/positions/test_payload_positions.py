"""Payloads of uncertain mass and centre in campaigns of positions, against machines made here.

The arm is weightless and its DH parameters are right, so that only springs, tool, frame and payload
are unknown: the pipeline must find what a dense nonlinear least squares by differences finds.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.answer.contract import Body
from pipeline.answer.remarks import contradicted
from pipeline.library.kinematic_model import dumps, kinematic_model
from pipeline.library.target_model import loads, predict
from pipeline.machine.robot import load
from pipeline.machine.robot.mdh import parse
from pipeline.positions.answer import by_readings, payload_entries
from pipeline.positions.calibrate import ModelStructure, calibrate
from pipeline.positions.initial import begin
from pipeline.positions.mechanism import ArmWeights, Payloads, layout
from pipeline.positions.readings import PositionReadings
from pipeline.positions.scatter import PoseScatter

# UR10 from its maker's table (distal DH)
TABLE = list(
    zip(
        [0.1273, 0.0, 0.0, 0.163941, 0.1157, 0.0922],
        [0.0, -0.612, -0.5723, 0.0, 0.0, 0.0],
        [np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0],
        strict=True,
    )
)
GRAVITY = np.array([0.0, 0.0, -9.80665])
NOISE, JOINT = 2e-5, 2e-5
MASS, CENTRE = 9.0, np.array([0.02, -0.03, 0.1])
STATED = np.array([0.45, 0.01, 0.01, 0.01])
TOOL, PLACE, TURN = np.array([0.05, -0.02, 0.12]), np.array([1.5, 0.3, 0.2]), 0.4


def flange(q):
    """Frames of the flange, (..., 4, 4) of joint values (..., 6)."""
    T = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
    for theta, (d, a, alpha) in zip(np.moveaxis(q, -1, 0), TABLE, strict=True):
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        o, one = np.zeros_like(c), np.ones_like(c)
        rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s],
                [o, sa * one, ca * one, d * one], [o, o, o, one]]  # fmt: skip
        T = T @ np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    return T


def at_flange(q, point):
    T = flange(q)
    return T[..., :3, :3] @ point + T[..., :3, 3]


def torque(q, mass, centre):
    """Derivative of the potential energy of the weight by each joint, by differences."""
    step = 1e-6 * np.eye(6)
    ahead, behind = (at_flange(q[..., None, :] + e, centre) for e in (step, -step))
    return mass * (ahead - behind) @ GRAVITY / 2e-6


def target(q, carried, x):
    """Positions of the target in F_b; x has compliances, tool point, errors of mass and centre."""
    c, tool, off = x[:6], x[6:9], x[9:13]
    turned = np.zeros_like(q)
    for _ in range(3):  # the payload hangs on the deflected arm
        hangs = c * torque(q + turned, MASS + off[0], CENTRE + off[1:])
        turned = np.where(np.asarray(carried)[..., None] != 0, hangs, 0.0)
    return at_flange(q + turned, tool)


def weightless_arm():
    """The UR10 without the masses of its links."""
    lines = load("ur10").text.splitlines()
    light = [line for line in lines if not line.startswith(("mass_kg", "centre_of_mass_m"))]
    return parse("\n".join(light), "ur10")


class Machine:
    """True parameters of one campaign, and its readings."""

    def __init__(self, seed, poses=80):
        rng = np.random.default_rng(seed)
        self.robot = weightless_arm()
        nominal = self.robot.nominal_compliance
        off = STATED * rng.standard_normal(4)
        self.x = np.concatenate([nominal * rng.uniform(0.5, 1.5, 6), TOOL, off])
        self.q, self.carried = self.poses(rng, poses)
        self.rng = rng
        self.measure()

    def measure(self):
        """Read the target once at each pose."""
        poses, rng = len(self.q), self.rng
        R = Rotation.from_rotvec([0.0, 0.0, TURN]).as_matrix()
        there = self.places(self.q + JOINT * rng.standard_normal((poses, 6)), self.carried)
        self.at = there @ R.T + PLACE + NOISE * rng.standard_normal((poses, 3))

    def poses(self, rng, count):
        """Joint values, and the load: none and the tool alternately."""
        q = rng.uniform([-3, -2.4, -2.2, -3, -2.5, -2.5], [3, 0.1, 2.2, 3, 2.5, 2.5], (count, 6))
        return q, (np.arange(count) % 2).astype(np.int64)

    def places(self, q, carried):
        """Position of the target [m], F_b."""
        return target(q, carried, self.x)

    @property
    def readings(self):
        """Readings of the instrument."""
        m = len(self.q)
        return PositionReadings(
            series=np.zeros(m, dtype=np.int64),
            names=np.array([""], dtype=object),
            pose=np.arange(m),
            file=np.full(m, "poses.csv", dtype=object),
            line=np.arange(m) + 2,
            q=self.q,
            targets=np.array(["T"], dtype=object),
            six=np.array([False]),
            at=self.at[:, None],
            turn=np.tile(np.eye(3), (m, 1, 1, 1)),
            payload=self.carried,
            payloads=np.array(["tool", "other"], dtype=object),
            temperature=np.full(m, np.nan),
        )

    def identified(self, stated=STATED):
        """Estimate springs with right DH parameters and the true noise."""
        std = np.stack([stated, 2 * STATED])
        known = Payloads(("tool", "other"), np.array([MASS, 4.0]), np.stack([CENTRE] * 2), std)
        scatter = PoseScatter(np.full(6, JOINT), NOISE, 1e-5, True)
        return calibrate(
            begin(self.robot, self.readings, {"T": TOOL}),
            self.readings,
            ArmWeights(GRAVITY, known, self.carried),
            ModelStructure(table=False),
            scatter,
        )


def slopes(function, x, steps):
    """Derivatives of a vector by central differences, one column per step."""
    columns = [
        (function(x + h) - function(x - h)) / (2 * s)
        for h, s in zip(np.diag(steps), steps, strict=True)
    ]
    return np.stack(columns, axis=1)


def dense(machine, found):
    """Compliances, tool, frame and payload by Gauss-Newton on differences; prior as stated."""
    W = found.rows.W[:, :3, :3]
    nominal = machine.robot.nominal_compliance

    def residual(y):
        R = Rotation.from_rotvec(y[13:16]).as_matrix()
        places = target(machine.q, machine.carried, y[:13])
        own = (machine.at - y[16:19]) @ R
        rows = np.einsum("mij,mj->mi", W, own - places).ravel()
        return np.concatenate([rows, (y[:6] - nominal) / nominal, y[9:13] / STATED])

    y = np.concatenate([nominal, TOOL, np.zeros(4), [0.0, 0.0, TURN], PLACE])
    step = np.concatenate(
        [1e-9 * np.ones(6), 1e-6 * np.ones(3), 1e-4 * np.ones(4), 1e-7 * np.ones(6)]
    )
    for _ in range(5):
        J = slopes(residual, y, step)
        Q, R = np.linalg.qr(J)
        y = y - np.linalg.solve(R, Q.T @ residual(y))
    inverse = np.linalg.inv(R)
    return y, inverse @ inverse.T


@pytest.fixture(scope="module")
def one():
    machine = Machine(3)
    return machine, machine.identified()


def test_springs_and_payload_are_those_of_a_dense_least_squares(one):
    """Values to a hundredth of their uncertainty, uncertainties to a thousandth."""
    machine, found = one
    y, cov = dense(machine, found)
    where, std = layout(found.mechanism), np.sqrt(np.diag(cov))
    part = np.r_[where.compliance, where.payload.start : where.payload.start + 4]
    mine = np.r_[0:6, 9:13]

    x, u = found.solution.x[part], np.sqrt(np.diag(found.solution.cov)[part])
    assert np.all(np.abs(x - y[mine]) < 0.01 * std[mine])
    assert u == pytest.approx(std[mine], rel=2e-3)
    assert np.all(np.abs(found.mechanism.payload[0] - y[9:13]) < 0.01 * std[9:13])
    assert u[6] == pytest.approx(STATED[0], rel=0.05)  # mass and springs are scaled together
    assert np.all(u[7:] < 0.5 * STATED[1:])


@pytest.mark.whole
def test_a_prediction_knows_what_it_shares_with_the_springs(one):
    """Its uncertainty is that of the dense estimate of springs, payload and frame together.

    F_b is as realised by the instrument: uncertain is the position where the target is read.
    """
    machine, found = one
    y, cov = dense(machine, found)
    model = kinematic_model("made", found)
    q, carried = machine.poses(np.random.default_rng(5), 6)
    nothing = np.zeros((6, 3)), carried, np.full(6, np.nan)
    told = predict(model, q, *nothing)

    def seen(x, at, k):
        return Rotation.from_rotvec(x[13:16]).as_matrix() @ target(at, k, x[:13]) + x[16:19]

    steps = np.concatenate(
        [1e-9 * np.ones(6), 1e-6 * np.ones(3), 1e-4 * np.ones(4), 1e-7 * np.ones(6)]
    )
    back = Rotation.from_rotvec(y[13:16]).as_matrix().T
    for one_q, carries, std in zip(q, carried, told.std[:, 0, :3], strict=True):
        J = back @ slopes(lambda x, at=one_q, k=carries: seen(x, at, k), y, steps)
        Z = slopes(lambda at, k=carries: target(at, k, y[:13]), one_q, np.full(6, 1e-6))
        var = np.diag(J @ cov @ J.T + Z @ np.diag(found.scatter.joints**2) @ Z.T)
        assert std == pytest.approx(np.sqrt(var), rel=0.03)
    again = loads(dumps(model), "positions.npz")
    assert predict(again, q, *nothing).std == pytest.approx(told.std, rel=1e-3)


def test_a_payload_that_was_never_carried_has_the_uncertainty_that_is_stated(one):
    """Its mass and centre stay as stated, and their uncertainty enters a prediction."""
    _, found = one
    where = layout(found.mechanism)
    other = slice(where.payload.start + 4, where.payload.stop)
    q = np.array([[0.0, -0.3, 0.2, 0.0, 0.5, 0.0]])
    model = kinematic_model("made", found)

    def told(payload):
        return predict(model, q, np.zeros((1, 3)), np.array([payload]), np.full(1, np.nan)).std

    assert found.mechanism.payload[1] == pytest.approx(np.zeros(4), abs=1e-9)
    assert np.sqrt(np.diag(found.solution.cov)[other]) == pytest.approx(2 * STATED, rel=1e-6)
    assert told(2)[0, 0, 2] > 1.2 * told(0)[0, 0, 2]


def test_a_payload_that_is_not_what_is_stated_is_said_to_be(one):
    """By its centre, which springs do not absorb.

    Within the stated uncertainty nothing is reported.
    """
    right, never = payload_entries(one[1])
    machine = Machine(4)
    machine.x[9:13] = 5 * STATED * [0, 1, -1, 1]
    machine.measure()
    wrong, _ = payload_entries(machine.identified())

    assert (right.poses, never.poses, never.found) == (40, 0, None)
    assert right.p_value > 0.001 > wrong.p_value
    assert wrong.found.center_m == pytest.approx(CENTRE + machine.x[10:13], abs=0.01)
    assert contradicted((right, never), "positions") == []
    assert "positions contradict the payload tool" in contradicted((wrong,), "positions")[0]
    assert payload_entries(machine.identified(np.zeros(4)))[0].found is None


@pytest.mark.slow
def test_intervals_hold_the_truth_over_30_campaigns():
    """Springs and predictions, with mass and centre drawn as stated.

    Not without their uncertainty.
    """
    springs, places, blind = [], [], []
    for seed in range(100, 130):
        machine = Machine(seed)
        truth = machine.x[:6]
        for stated, kept in ((STATED, springs), (np.zeros(4), blind)):
            found = machine.identified(stated)
            part = layout(found.mechanism).compliance
            std = np.sqrt(np.diag(found.solution.cov)[part])
            kept.append(np.abs(found.solution.x[part] - truth) < 1.96 * std)
            if kept is springs:
                q, carried = machine.poses(machine.rng, 20)
                told = predict(
                    kinematic_model("m", found), q, np.zeros((20, 3)), carried, np.full(20, np.nan)
                )
                true = machine.places(q + JOINT * machine.rng.standard_normal(q.shape), carried)
                places.append(np.abs(told.at[:, 0] - true) < 1.96 * told.std[:, 0, :3])

    held = [float(np.mean(one)) for one in (springs, places, blind)]
    assert 0.90 < held[0] < 0.99, held  # 180 springs
    assert 0.93 < held[1] < 0.97, held  # 1800 coordinates
    assert held[2] < 0.85, held


@pytest.mark.parametrize(("alone", "std"), [(155.0, 8.0), (200.0, 40.0), (180.0, 0.05)])
def test_a_mass_that_readings_hardly_test_is_told_as_they_have_it_by_themselves(alone, std):
    """The mean of it and the stated one, weighed by their uncertainties, is nearly the stated one.

    A mass that the readings know about as well as the file needs no such remark.
    """
    stated, u = 180.0, 0.2
    weight = u**-2 + std**-2
    both = (stated / u**2 + alone / std**2) / weight
    body = Body(mass_kg=both, mass_std_kg=weight**-0.5, center_m=(0, 0, 0), center_std_m=(0, 0, 0))

    told = by_readings(stated, u, body)

    assert told == (None if std < 1 else pytest.approx((alone, std), rel=1e-3))


def test_a_mass_of_which_nothing_is_read_has_no_value_of_its_own():
    """Rounding of the last digits would make one up."""
    body = Body(mass_kg=180.0, mass_std_kg=0.2, center_m=(0, 0, 0), center_std_m=(0, 0, 0))

    assert by_readings(180.0, 0.2, body) == (180.0, np.inf)
