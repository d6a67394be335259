"""The model in formats of simulators: the same robot, springs and deflection.

Here frames are multiplied with SciPy's rotations, placements compared with Pinocchio's, and
deflections are those of MuJoCo and Drake with their own files.
"""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from bench.as_pinocchio import model as pin_model
from pipeline.exchange.files import simulators
from pipeline.exchange.to_urdf import urdf
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import SHIPPED, load
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis

POINTS = {"load_point": (0.15, 0.0, 0.25), "P1": (0.2, 0.05, 0.12), "P 2/::ü": (-0.1, 0.2, 0.1)}
UPRIGHT = Rotation.from_euler("xyz", [[0.3, 0.5 * np.pi, 0], [0.2, -0.5 * np.pi, 0.7]]).as_matrix()
EXACT = [[[0, -1, 0], [0, 0, -1], [1, 0, 0]], [[0, -1, 0], [0, 0, 1], [-1, 0, 0]]]
"""Frames with a pitch of 90 degrees, with rounding and without."""


def model(robot, std=None):
    """A robot with nominal stiffnesses, each with the standard uncertainty `std`."""
    cell = paper_cell(robot, Tool.of(POINTS))
    value = robot.nominal_compliance
    cov = np.diag((value * (np.full(robot.n, 0.01) if std is None else std)) ** 2)
    return IdentifiedModel(
        "made -- up", "adequate", {"reason": "adequate"}, (ModelHypothesis(1.0, cell, value, cov),)
    )


def written(made, file):
    return simulators(made)[file].decode()


def poses(robot, rng, count):
    """Joint values within the limits, (count, n) [m] or [rad]."""
    ends = (np.clip(robot.lower, -3, None), np.clip(robot.upper, None, 3))
    return rng.uniform(*ends, (count, robot.n))


def step(rotation=None, shift=(0, 0, 0)):
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = np.eye(3) if rotation is None else rotation.as_matrix(), shift
    return frame


def numbers(text):
    return np.array([float(word) for word in text.split()])


def move(kind, q):
    """Motion of a joint along or about its z axis."""
    if kind in ("slide", "prismatic"):
        return step(shift=(0, 0, q))
    return step(Rotation.from_rotvec([0, 0, q]))


def points_of_mjcf(text, q):
    """Position of each site: bodies from outside to inside, each with its joint [m]."""
    here, body, left = np.eye(4), ET.fromstring(text).find("worldbody/body"), list(q)
    while body is not None:
        turned = numbers(body.get("quat", "1 0 0 0"))
        here = here @ step(
            Rotation.from_quat(turned[[1, 2, 3, 0]]), numbers(body.get("pos", "0 0 0"))
        )
        joint, last = body.find("joint"), body
        if joint is not None:
            assert joint.get("axis") == "0 0 1"
            here = here @ move(joint.get("type"), left.pop(0))
        body = body.find("body")
    sites = last.findall("site")
    return {s.get("name"): here[:3, :3] @ numbers(s.get("pos")) + here[:3, 3] for s in sites}


def points_of_sdf(text, q):
    """Position of each frame: links by their joints, frames on what they are attached to [m]."""
    whole, at = ET.fromstring(text).find("model"), {"F_b": np.eye(4)}
    moved = {j.findtext("child"): j for j in whole.findall("joint") if j.get("type") != "fixed"}
    left = list(q)
    for link in whole.findall("link")[1:]:
        joint = moved[link.get("name")]
        assert link.find("pose").get("relative_to") == joint.findtext("parent")
        before = at[joint.findtext("parent")] @ pose(link)
        at[link.get("name")] = before @ move(joint.get("type"), left.pop(0))
    for frame in whole.findall("frame"):
        at[frame.get("name")] = at[frame.get("attached_to")] @ pose(frame)
    return {frame.get("name"): at[frame.get("name")][:3, 3] for frame in whole.findall("frame")}


def pose(of):
    x, y, z, roll, pitch, yaw = numbers(of.findtext("pose"))
    return step(Rotation.from_euler("xyz", [roll, pitch, yaw]), (x, y, z))


def truth(robot, q):
    """Tool points and flange by Pinocchio [m], in the order of the files."""
    built = pin_model(robot, {name: np.array(at) for name, at in POINTS.items()})
    data = built.createData()
    pin.framesForwardKinematics(built, data, q)
    return [data.oMf[built.getFrameId(name)].translation for name in ("flange", *POINTS)]


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", SHIPPED)
def test_the_files_have_the_robot_where_it_is(name):
    """Tool points at any joint values, in MJCF and SDF, agree with Pinocchio to a nanometre."""
    robot = load(name)
    made = model(robot)
    for q in poses(robot, np.random.default_rng(1), 5):
        expected = np.array(truth(robot, q))
        mjcf = points_of_mjcf(written(made, "model.xml"), q)
        sdf = points_of_sdf(written(made, "model.sdf"), q)

        assert list(mjcf) == ["F_flange", *POINTS]
        assert list(sdf) == ["F_flange", "load_point", "P1", "P 2/:ü"]  # :: separates scopes in SDF
        assert np.array(list(mjcf.values())) == pytest.approx(expected, abs=1e-9)
        assert np.array(list(sdf.values())) == pytest.approx(expected, abs=1e-9)


def test_frames_turned_by_a_right_angle_keep_their_orientation():
    """If roll and yaw have the same axis, in URDF, MJCF and SDF."""
    robot = load("kr500_rail")
    placement, q = robot.placement.copy(), np.linspace(0.1, 0.7, 7)
    placement[1:5, :3, :3] = [*UPRIGHT, *EXACT]
    turned = replace(robot, placement=placement)
    made, expected = model(turned), np.array(truth(turned, q))
    theirs = pin.buildModelFromXML(urdf(made).decode())
    data = theirs.createData()
    pin.framesForwardKinematics(theirs, data, q)

    load_point = data.oMf[theirs.getFrameId("load_point")].translation
    assert load_point == pytest.approx(expected[1], abs=1e-9)
    for found in (
        points_of_mjcf(written(made, "model.xml"), q),
        points_of_sdf(written(made, "model.sdf"), q),
    ):
        assert np.array(list(found.values())) == pytest.approx(expected, abs=1e-9)


def test_every_joint_has_the_spring_that_was_found():
    """Stiffness to the last digit, about zero unless set otherwise."""
    robot = load("kr500_rail")
    made = model(robot)
    expected = [made.stiffness(j)[0] for j in range(robot.n)]
    joints = list(ET.fromstring(written(made, "model.xml")).iter("joint"))
    springs = list(ET.fromstring(written(made, "model.sdf")).iter("dynamics"))

    assert [float(j.get("stiffness")) for j in joints] == expected
    assert {j.get("springref") for j in joints} == {"0.0"}
    assert [j.get("limited") for j in joints] == ["false"] * 7
    assert [float(s.findtext("spring_stiffness")) for s in springs] == expected
    assert {s.findtext("spring_reference") for s in springs} == {"0.0"}


def test_a_joint_without_a_value_gets_that_of_the_table_and_says_so():
    """A simulator needs a spring at every joint; a nominal one must not be taken for measured."""
    robot = load("kr500_rail")
    std = np.full(7, 0.01)
    std[5] = np.inf
    made = model(robot, std)
    root = ET.fromstring(written(made, "model.xml"))
    said = {text.get("name"): text.get("data") for text in root.iter("text")}
    joint = next(j for j in root.iter("joint") if j.get("name") == "theta6")

    assert float(joint.get("stiffness")) == robot.joints[5].stiffness
    assert "of the robot's table, not determined" in said["stiffness_theta6"]
    assert "standard uncertainty" in said["stiffness_theta5"]
    assert written(made, "model.sdf").count("not determined by the campaign") == 1


def test_what_a_spring_cannot_carry_stands_in_the_file():
    """Causes, hypotheses and covariance, which model.toml has, are named in both files."""
    robot = load("kr500_rail")
    (one,) = model(robot).hypotheses
    roll = next(e for e in catalogue(robot) if e.label == "rail_roll")
    cov = np.diag(np.append(np.diag(one.cov), 1e-18))
    other = ModelHypothesis(0.25, one.cell.with_effects(roll), np.append(one.value, 2e-8), cov)
    made = IdentifiedModel("c", "ambiguous", {}, (replace(one, weight=0.75), other))
    text = ET.fromstring(written(made, "model.xml")).find("custom")
    said = {each.get("name"): each.get("data") for each in text}

    for words in (said["only_in_model_toml"], written(made, "model.sdf")):
        assert "rail_roll" in words
        assert "weights 0.75, 0.25" in words
        assert "covariance of the stiffnesses" in words


def test_links_weigh_what_the_table_says():
    """Masses and centres if the robot file has them; substitutes are labelled as such."""
    heavy, light = load("ur10"), load("kr500_rail")
    inertial = list(ET.fromstring(written(model(heavy), "model.xml")).iter("inertial"))
    masses = [
        float(one.findtext("mass"))
        for one in ET.fromstring(written(model(heavy), "model.sdf")).iter("inertial")
    ]

    assert [float(one.get("mass")) for one in inertial] == [j.mass_kg for j in heavy.joints]
    assert masses == [j.mass_kg for j in heavy.joints]
    for one, joint in zip(inertial, heavy.joints, strict=True):
        assert numbers(one.get("pos")) == pytest.approx(joint.centre_of_mass_m)
    assert "no mass for the links" not in written(model(heavy), "model.xml")
    assert "no mass for the links behind r1, theta2" in written(model(light), "model.xml")


# --- in the simulators themselves ------------------------------------------------------------


def cases(robot, rng, count, largest):
    """Poses, and forces in every direction up to `largest` [N]."""
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return poses(robot, rng, count), direction * rng.uniform(0, largest, (count, 1))


def deformed(made, q, force):
    """Deflection of the tool points in our own equilibrium on the deflected robot, (t, 3) [m]."""
    (one,) = made.hypotheses
    bent = replace(one, cell=replace(one.cell, equilibrium="deformed"))
    points = np.array(list(POINTS.values()))
    found = replace(made, hypotheses=(bent,)).positions(q[None], force[None], points)
    return found.loaded[0] - found.unloaded[0]


class InMujoco:
    """A robot at rest in MuJoCo, with MuJoCo's springs and kinematics."""

    def __init__(self, made):
        self.mujoco = pytest.importorskip("mujoco", reason="the package mujoco is not installed")
        self.model = self.mujoco.MjModel.from_xml_string(written(made, "model.xml"))
        self.data = self.mujoco.MjData(self.model)
        self.body = self.model.site("load_point").bodyid[0]

    def pull(self, force):
        """Joint forces and torques of a force at the load point [N] or [N m]."""
        tau = np.zeros(self.model.nv)
        at = self.data.site("load_point").xpos
        self.mujoco.mj_applyFT(self.model, self.data, force, np.zeros(3), at, self.body, tau)
        return tau

    def command(self, q):
        """Set the commanded pose as docs/hand-over.md describes."""
        self.data.qvel[:] = 0.0
        self.data.qpos[:] = self.model.qpos_spring[:] = q
        self.mujoco.mj_forward(self.model, self.data)

    def points(self):
        """Positions of the tool points [m], shape (t, 3)."""
        return np.array([self.data.site(name).xpos for name in POINTS])

    def deflection(self, q, force):
        """Deflection of the tool points at rest under a force [m], shape (t, 3)."""
        self.command(q)
        before = self.points()
        for _ in range(40):
            missing = self.data.qfrc_passive + self.pull(force)
            self.data.qpos += missing / self.model.jnt_stiffness
            self.mujoco.mj_forward(self.model, self.data)
        assert np.abs(self.data.qfrc_passive + self.pull(force)).max() < 1e-5
        return self.points() - before


class InDrake:
    """The same in Drake, whose springs are read from a file with the commanded pose."""

    def __init__(self, made):
        pytest.importorskip("pydrake", reason="the package drake is not installed")
        self.text = written(made, "model.sdf")

    def deflection(self, q, force):
        """Deflection of the tool points at rest under a force [m], shape (t, 3)."""
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces

        root = ET.fromstring(self.text)
        for reference, value in zip(root.iter("spring_reference"), q, strict=True):
            reference.text = repr(float(value))
        plant = MultibodyPlant(0.0)
        Parser(plant).AddModelsFromString(ET.tostring(root, "unicode"), "sdf")
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        plant.Finalize()
        context, world = plant.CreateDefaultContext(), plant.world_frame()
        frames = [plant.GetFrameByName(name.replace("::", ":")) for name in POINTS]
        stiffness = [float(k.text) for k in root.iter("spring_stiffness")]
        kind = JacobianWrtVariable.kV

        def missing():
            forces = MultibodyForces(plant)
            plant.CalcForceElementsContribution(context, forces)
            J = plant.CalcJacobianTranslationalVelocity(
                context, kind, frames[0], np.zeros(3), world, world
            )
            return forces.generalized_forces() + J.T @ force

        def points():
            return np.array([f.CalcPoseInWorld(context).translation() for f in frames])

        plant.SetPositions(context, q)
        before = points()
        for _ in range(40):
            plant.SetPositions(context, plant.GetPositions(context) + missing() / stiffness)
        assert np.abs(missing()).max() < 1e-5
        return points() - before


@pytest.mark.slow
@pytest.mark.parametrize("simulator", [InMujoco, InDrake])
@pytest.mark.parametrize("name", ["kr500_rail", "ur10e", "kr210_r2700_2"])
def test_a_simulator_deflects_as_the_model_does(simulator, name):
    """A hundred poses and forces up to 3 kN: the deformed equilibrium; to 100 N the linear one."""
    robot = load(name)
    made = model(robot)
    there = simulator(made)
    rng, size = np.random.default_rng(5), robot.payload_kg or 500.0
    largest = 3000.0 if size >= 100 else 10 * size
    for q, force in zip(*cases(robot, rng, 100, largest), strict=True):
        assert there.deflection(q, force) == pytest.approx(deformed(made, q, force), abs=1e-6)
    for q, force in zip(*cases(robot, rng, 100, largest / 30), strict=True):
        moved = made.predict(q, force).displacement[0]
        assert there.deflection(q, force)[0] == pytest.approx(moved, abs=1e-6)


@pytest.mark.slow
def test_a_robot_in_mujoco_comes_to_rest_where_it_should():
    """Stepped through time as users do it, from the unloaded pose: at rest within a second."""
    robot = load("kr500_rail")
    made = model(robot)
    there, q = InMujoco(made), np.array([5.0, 0.2, 0.6, 0.5, 0.4, -0.6, 0.3])
    force = np.array([1200.0, -1800.0, 900.0])
    there.command(q)
    before = there.points()
    for _ in range(1000):
        there.data.qfrc_applied[:] = there.pull(force)
        there.mujoco.mj_step(there.model, there.data)

    assert there.data.time == pytest.approx(1.0)
    assert there.points() - before == pytest.approx(deformed(made, q, force), abs=1e-6)
    assert np.linalg.norm(there.points() - before, axis=1).min() > 5e-4
