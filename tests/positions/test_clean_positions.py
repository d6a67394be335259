"""Campaigns of positions of arms that have nothing but what every arm has.

Errors of the table, springs under their weight and noise call for no law and no cause. The arms are
multiplied out here, and the torque of the weight is a difference of its potential energy.
"""

from functools import reduce

import numpy as np
import pytest
from heavy_robot import of_three
from scipy.spatial.transform import Rotation

from pipeline.diagnosis.finding import Verdict
from pipeline.diagnosis.verdict import verdict
from pipeline.machine.robot import load
from pipeline.positions.facts import facts_of
from pipeline.positions.mechanism import ArmWeights, Payloads
from pipeline.positions.study import ModelStage, study

DOWN = np.array([0.0, 0.0, -9.80665])
TOOL = np.array([[0.14, 0.04, 0.09], [-0.09, 0.13, 0.07], [-0.07, -0.12, 0.15]])
RANGE = np.array([[-170, 20, -70, -180, -110, -180], [170, 140, 70, 180, 110, 180]])
TWISTS = {"khalil": [0, 90, 0, 90, -90, 90], "craig": [0, 90, 0, 90, -90, 90],
          "standard": [90, 0, 90, -90, 90, 0]}  # fmt: skip
MASS = np.array([240.0, 150.0, 130.0, 50.0, 22.0, 8.0])
STIFF = np.array([1.8e6, 1.6e6, 1.1e6, 2e5, 2e5, 1.5e5])


def along(axis, v):
    """Translations along an axis, v (m,), shape (m, 4, 4)."""
    T = np.tile(np.eye(4), (len(v), 1, 1))
    T[:, axis, 3] = v
    return T


def about(axis, v):
    """Rotations about an axis."""
    T = np.tile(np.eye(4), (len(v), 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(np.outer(v, np.eye(3)[axis])).as_matrix()
    return T


class Arm:
    """Six axes of some convention, lengths, masses and stiffnesses, and the errors of one arm."""

    def __init__(self, convention, rng):
        self.convention, size = convention, rng.uniform(0.7, 1.3)
        first, other = ([0, 0.3, 1.0, 0.1, 0, 0], [0.3, 1.0, 0.1, 0, 0, 0])
        self.length = size * np.array(other if convention == "standard" else first)
        self.offset = size * np.array([0.6, 0, 0, 1.0, 0, 0.2])
        self.twist = np.deg2rad(TWISTS[convention])
        self.mass = MASS * rng.uniform(0.7, 1.3, 6)
        self.centre = rng.normal(0, 0.1, (6, 3)) * size
        self.centre[1, 0] += (-0.4 if convention == "standard" else 0.4) * size
        self.stiff = STIFF * rng.uniform(0.7, 1.4, 6)
        off = rng.normal(0, 1, (4, 6)) * [[3e-4], [3e-4], [4e-4], [5e-4]]
        self.errors = dict(zip(("length", "offset", "twist", "zero"), off, strict=True))

    def links(self, q):
        """Frames of all links at joint angles (m, 6), six of shape (m, 4, 4)."""
        e, T, out = self.errors, np.tile(np.eye(4), (len(q), 1, 1)), []
        ones = np.ones(len(q))
        for j in range(6):
            joint = (
                about(2, q[:, j] + e["zero"][j]),
                along(2, ones * (self.offset + e["offset"])[j]),
            )
            link = (
                along(0, ones * (self.length + e["length"])[j]),
                about(0, ones * (self.twist + e["twist"])[j]),
            )
            order = (*joint, *link) if self.convention == "standard" else (*link[::-1], *joint)
            T = reduce(np.matmul, order, T)
            out.append(T)
        return out

    def energy(self, q):
        """Potential energy of all links, (m,) [N m]."""
        frames = self.links(q)
        heights = [T[:, 2, :3] @ c + T[:, 2, 3] for T, c in zip(frames, self.centre, strict=True)]
        return 9.80665 * self.mass @ np.array(heights)

    def sagged(self, q):
        """Joint angles at which the springs hold the weight."""
        out, h = q, 1e-4 * np.eye(6)
        for _ in range(3):
            rise = [self.energy(out + one) - self.energy(out - one) for one in h]
            out = q - np.array(rise).T / 2e-4 / self.stiff
        return out

    def file(self, masses):
        """The robot file as delivered."""
        names = ("d_m", "r_m") if self.convention == "khalil" else ("a_m", "d_m")
        text = f'format = 1\nname = "own"\nconvention = "{self.convention}"\nsource = "drawing"\n'
        text += 'description = "drawn"\npayload_kg = 60\n'
        for j in range(6):
            low, high = RANGE[:, j] + [-5, 5]
            text += f'\n[[joint]]\nname = "theta{j + 1}"\ntype = "revolute"\n'
            text += f"alpha_deg = {np.rad2deg(self.twist[j])}\n"
            text += f"{names[0]} = {self.length[j]}\n{names[1]} = {self.offset[j]}\n"
            text += f"lower_deg = {low}\nupper_deg = {high}\nstiffness_nm_per_rad = {STIFF[j]}\n"
            if masses:
                text += f"mass_kg = {self.mass[j]}\n"
                text += f"centre_of_mass_m = {self.centre[j].tolist()}\n"
        return text


def seen(hand, at, rng):
    """Positions as an instrument at F_b (4, -3, 1) reads them, by one of three hands of noise."""
    if hand == "even":
        return at + 2e-5 * rng.standard_normal(at.shape)
    beam = at - [4.0, -3.0, 1.0]
    beam /= (distance := np.linalg.norm(beam, axis=-1, keepdims=True))
    noise = rng.standard_normal(at.shape) * (1e-5 + 5e-6 * distance)
    noise -= 0.8 * beam * np.sum(noise * beam, axis=-1, keepdims=True)
    return at + noise


def campaign(seed, convention, masses, hand, folder):
    """Robot file and readings of one arm of 30 to 45 poses."""
    rng = np.random.default_rng(seed)
    arm = Arm(convention, rng)
    path = folder / "own.toml"
    path.write_text(arm.file(masses))
    m = int(rng.integers(30, 46))
    q = np.deg2rad(rng.uniform(*RANGE, (m, 6)))
    real = q + 1e-5 * rng.standard_normal(q.shape) * (hand == "joints")
    T = arm.links(arm.sagged(real))[-1]
    at = np.einsum("mij,tj->mti", T[:, :3, :3], TOOL) + T[:, None, :3, 3]
    at = seen("even" if hand == "joints" else hand, at, rng)
    turn = Rotation.from_euler("zx", [rng.uniform(-3, 3), 0.2]).as_matrix()
    readings = of_three(q, at @ turn + rng.uniform(-2, 2, 3))
    return load(str(path)), readings


ARMS = [
    (1, "craig", True, "beam"), (7, "standard", False, "beam"),
    (0, "khalil", True, "even"), (2, "standard", True, "joints"), (6, "craig", False, "even"),
    (3, "khalil", True, "beam"), (4, "craig", True, "joints"), (5, "standard", True, "even"),
]  # fmt: skip
"""Seed, convention, whether the file states masses, how they lie; the first two differ in each."""


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("seed", "convention", "masses", "hand"), ARMS)
def test_an_arm_without_a_defect_is_given_no_law_and_no_cause(
    seed, convention, masses, hand, tmp_path
):
    """Where the file states no masses, the weight of the arm is all that may be identified."""
    robot, readings = campaign(seed, convention, masses, hand, tmp_path)
    none = Payloads((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)))
    weights = ArmWeights(DOWN, none, np.zeros(len(readings), dtype=np.int64))
    tool = {f"P{k}": point for k, point in enumerate(TOOL, 1)}
    rough = (np.nan, np.nan)

    found = study(robot, readings, weights, tool, 2e-5, rough, np.random.default_rng(0))

    assert found.laws == ()
    assert {one.name for one in found.causes} == (set() if masses else {"gravity_sag"})
    green = Verdict.ADEQUATE if masses else Verdict.EXPLAINED
    assert verdict(facts_of(found, robot)) is green
    waves = [one.found.wanted.laws for one in found.stages if one.step is ModelStage.CATALOGUE]
    assert {law.joint for law in waves[0]} <= {2}  # a balancer's; others' gain is that of laws
