"""Campaigns of positions and pulls of one arm with known truth, by Pinocchio alone."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from heavy_robot import TOOL, HeavyRobot, Truth, errors_of_table

from pipeline.machine.robot import load

GAIN_STD = 0.002
LOAD_POINT = np.array([0.1, 0.0, 0.2])
BASE = {"B1": [0.8, -0.9, -0.3], "B2": [0.8, 0.9, -0.3], "B3": [-0.8, 0.9, -0.28],
        "B4": [-0.8, -0.9, -0.31]}  # fmt: skip
LOW, HIGH = np.deg2rad([[-120, -110, -60, -150, -100, -170], [120, -20, 90, 150, 100, 170]])
TRACKER = pin.exp3(np.array([0.02, -0.03, 0.9])), np.array([3.0, -4.0, 0.6])
OTHER = pin.exp3(np.array([0.01, 0.05, -1.4])), np.array([-2.0, 3.5, 1.1])


@dataclass
class Mixed:
    """The files of a campaign, and what hides in it.

    Attributes:
        files: By name.
        machine: The arm.
        compliance: Of its joints [rad/(N m)].
        tool: Where its reflectors are [m], flange frame.
    """

    files: dict
    machine: HeavyRobot
    compliance: np.ndarray
    tool: np.ndarray

    def without(self, table):
        """The files of one kind of readings: `positions` or `tracker` is left out."""
        blocks = self.files["campaign.toml"].split("\n\n")
        gone = {"positions": ("[positions]",), "tracker": ("[tracker]", "[scale]")}[table]
        kept = [one for one in blocks if not one.startswith(gone)]
        return self.files | {"campaign.toml": "\n\n".join(kept)}

    def encoded(self, table=None):
        """Bytes by name, for `load_campaign`."""
        files = self.files if table is None else self.without(table)
        return {name: text.encode() for name, text in files.items()}


def mixed(seed, poses=60, pulled=8, masses=True, noise=2e-5, weight=1.0):
    """A campaign: positions at `poses` poses, pulls of three steps in `pulled` others.

    Args:
        seed: Of everything that is drawn.
        poses: Whose positions are read, by a tracker that stands elsewhere.
        pulled: Poses that are pulled.
        masses: The robot file states the masses.
        noise: Of a coordinate [m].
        weight: Masses over those that the file states.
    """
    rng = np.random.default_rng(seed)
    robot = load("kr210_r2700_2")
    c = robot.nominal_compliance * np.exp(rng.normal(0, 0.3, robot.n))
    body = np.array([joint.mass_kg for joint in robot.joints]) * weight
    centre = np.array([joint.centre_of_mass_m for joint in robot.joints])
    off = errors_of_table(robot.n + 1, rng, 3e-4, 3e-4)
    machine = HeavyRobot(robot, off, Truth(c, mass=body, centre=centre))
    q = rng.uniform(LOW, HIGH, (poses + pulled, robot.n))
    gain = GAIN_STD * np.random.default_rng([seed, 2]).normal()
    read = _Reader(machine, TOOL + rng.normal(0, 1e-4, TOOL.shape), rng, noise, gain)
    files = {
        "campaign.toml": _toml(noise),
        "robot.toml": robot.text if masses else _without_masses(robot.text),
        "poses.csv": read.positions(q[:poses]),
        **read.pulls(q[poses:]),
    }
    return Mixed(files, machine, c, read.tool)


def _without_masses(text):
    lines = text.splitlines(keepends=True)
    return "".join(one for one in lines if not one.startswith(("mass_kg", "centre_of_mass_m")))


class _Reader:
    """What trackers, scale and controller write down of an arm.

    Attributes:
        machine: The arm.
        tool: Its reflectors [m], flange frame.
        rng: Draws noise.
        noise: Of a coordinate [m].
        gain: Relative error of the scale.
    """

    def __init__(self, machine, tool, rng, noise, gain):
        self.machine, self.tool, self.rng = machine, tool, rng
        self.noise, self.gain = noise, gain

    def _at(self, points, station):
        R, t = station
        return points @ R.T + t + self.rng.normal(0, self.noise, np.shape(points))

    def _stands(self, q, pull=None):
        """Flange under a pull; joints repeat to 5 microradians."""
        T = self.machine.flange(q, pull)
        return T[:3, :3], T[:3, 3]

    def _repeated(self, q):
        return q + self.rng.normal(0, 5e-6, q.shape)

    def positions(self, q):
        """poses.csv, by a tracker at an arbitrary position."""
        names = [joint.name for joint in self.machine.robot.joints]
        rows = ["pose,target,x_mm,y_mm,z_mm," + ",".join(f"{name}_deg" for name in names)]
        for k, one in enumerate(q, 1):
            R, o = self._stands(self._repeated(one))
            for t, at in enumerate(1e3 * self._at(self.tool @ R.T + o, OTHER), 1):
                place = ",".join(f"{x:.5f}" for x in at)
                rows.append(f"{k},P{t},{place}," + ",".join(f"{x:.6f}" for x in np.rad2deg(one)))
        return "\n".join(rows) + "\n"

    def pulls(self, q):
        """tracker.csv, loads.csv and joints.csv."""
        names = [joint.name for joint in self.machine.robot.joints]
        joints = ["pose," + ",".join(f"{name}_deg" for name in names)]
        shots, loads = ["group,target,x_mm,y_mm,z_mm"], ["pose,repeat,force_n"]

        def shot(group, target, point):
            at = ",".join(f"{x:.5f}" for x in 1e3 * self._at(np.asarray(point), TRACKER))
            shots.append(f"{group},{target},{at}")

        for name, at in BASE.items():
            shot("base_start", name, at)
        for k, one in enumerate(q, 1):
            joints.append(f"{k}," + ",".join(f"{x:.6f}" for x in np.rad2deg(one)))
            true = self._repeated(one)
            R, o = self._stands(true)
            for t, at in enumerate(self.tool @ R.T + o, 1):
                shot(f"pose{k:02d}_rep0_unloaded", f"P{t}", at)
            anchor = o + self.rng.normal(0, 1.0, 3) * [1, 1, 0.5] - [0, 0, 1.5]
            for repeat, size in enumerate((800.0, 1600.0, 2400.0), 1):
                R, o = self._stands(true, (size, LOAD_POINT, anchor))
                group = f"pose{k:02d}_rep{repeat}_loaded"
                for t, at in enumerate(self.tool @ R.T + o, 1):
                    shot(group, f"P{t}", at)
                tip = R @ LOAD_POINT + o
                for t, share in enumerate((0.2, 0.9), 1):
                    shot(group, f"Pl{t}", tip + share * (anchor - tip))
                read = size * (1 + self.gain) + self.rng.normal(0, 2.0)
                loads.append(f"{k},{repeat},{read:.3f}")
        for name, at in BASE.items():
            shot("base_end", name, at)
        files = {"tracker.csv": shots, "loads.csv": loads, "joints.csv": joints}
        return {name: "\n".join(lines) + "\n" for name, lines in files.items()}


def _toml(noise):
    base = "\n".join(f"{name} = {at}" for name, at in BASE.items())
    tool = "\n".join(f"P{k} = {at.tolist()}" for k, at in enumerate(TOOL, 1))
    return f"""format = 1
name = "mixed"
robot = "robot.toml"

[positions]
file = "poses.csv"
sigma_m = {noise}

[tracker]
files = ["tracker.csv"]
sigma_m = {noise}

[base_frame]
{base}

[scale]
sigma_n = 2.0
gain_sigma = {GAIN_STD}

[tool]
load_point = {LOAD_POINT.tolist()}
{tool}

[tool_uncertainty]
sigma_m = 1.0e-4
"""
