"""Campaigns of chains without reflectors towards named anchors, with known truth, by Pinocchio."""

from dataclasses import dataclass, replace

import numpy as np
from heavy_robot import TOOL, HeavyRobot, Truth
from mixed_campaign import BASE, HIGH, LOAD_POINT, LOW, TRACKER

from pipeline.machine.robot import load

PLACES = np.array([[2.4, 1.1, -0.62], [-1.35, 2.27, -0.58], [1.64, -2.13, 1.85],
                   [-2.06, -1.48, -0.41], [0.37, 2.91, 2.16]])  # fmt: skip


@dataclass(frozen=True)
class Anchored:
    """What hides in a campaign, and what is written down of it.

    Attributes:
        true: Places of the anchors [m], F_b, by name; those of reflectors of the base are theirs.
        stated: The same as campaign.toml has them.
        went: Anchor that each pull went to, by pose and repeat, in the order of the log.
        named: Anchor that the row of each names.
        poses: Number of poses.
        noise: Of a coordinate [m].
        lost: Half the lost motion of joint 3 [rad].
        seed: Of everything that is drawn.
    """

    true: dict
    stated: dict
    went: tuple
    named: tuple
    poses: int
    noise: float
    lost: float
    seed: int

    @classmethod
    def of(cls, seed, anchors=3, poses=12, pulls=3, noise=2e-5, lost=0.0):
        """Right in everything: each pose is pulled towards one to three of the anchors in turn."""
        rng = np.random.default_rng([seed, 1])
        at = PLACES[rng.permutation(len(PLACES))[:anchors]] + rng.uniform(-0.3, 0.3, (anchors, 3))
        true = {f"K{k}": one for k, one in enumerate(np.round(at, 3).tolist(), 1)}
        turn = [[(p + r * (p % 2)) % anchors + 1 for r in range(pulls)] for p in range(poses)]
        went = tuple(f"K{k}" for pose in turn for k in pose)
        return cls(true, dict(true), went, went, poses, noise, lost, seed)

    def stating(self, name, *at):
        """The same with an anchor stated elsewhere [m]."""
        return replace(self, stated=self.stated | {name: [round(float(x), 4) for x in at]})

    def naming(self, named):
        """The same with other anchors named in the rows of the log."""
        return replace(self, named=tuple(named))

    def files(self):
        """Bytes by name, for `load_campaign`."""
        rng = np.random.default_rng(self.seed)
        robot = load("kr210_r2700_2")
        c = robot.nominal_compliance * np.exp(rng.normal(0, 0.3, robot.n))
        massless = {"mass": np.full(robot.n, 1e-9), "centre": np.zeros((robot.n, 3))}
        truth = Truth(c, turned=self._lost if self.lost else None, **massless)
        machine = HeavyRobot(robot, np.zeros((robot.n + 1, 6)), truth)
        q = rng.uniform(LOW, HIGH, (self.poses, robot.n))
        pulls, places = len(self.went) // self.poses, BASE | self.true
        shots, loads = ["group,target,x_mm,y_mm,z_mm"], ["pose,repeat,force_n,anchor"]
        names = ",".join(f"{joint.name}_deg" for joint in robot.joints)
        joints = [f"pose,{names}"]

        def shot(group, target, point):
            at = np.asarray(point) @ TRACKER[0].T + TRACKER[1] + rng.normal(0, self.noise, 3)
            shots.append(f"{group},{target}," + ",".join(f"{x:.5f}" for x in 1e3 * at))

        def effector(group, T):
            for t, at in enumerate(TOOL @ T[:3, :3].T + T[:3, 3], 1):
                shot(group, f"P{t}", at)

        for name, at in BASE.items():
            shot("base_start", name, at)
        for p, one in enumerate(q, 1):
            joints.append(f"{p}," + ",".join(f"{x:.6f}" for x in np.rad2deg(one)))
            true = one + rng.normal(0, 5e-6, one.shape)
            effector(f"pose{p:02d}_rep0_unloaded", machine.flange(true))
            for r in range(1, pulls + 1):
                k = (p - 1) * pulls + r - 1
                size = rng.uniform(0.9, 1.1) * (900.0, 1700.0, 2500.0)[(r - 1) % 3]
                pull = size, LOAD_POINT, np.array(places[self.went[k]])
                effector(f"pose{p:02d}_rep{r}_loaded", machine.flange(true, pull))
                loads.append(f"{p},{r},{size + rng.normal(0, 2.0):.2f},{self.named[k]}")
        for name, at in BASE.items():
            shot("base_end", name, at)
        files = {"tracker.csv": shots, "loads.csv": loads, "joints.csv": joints}
        files = {name: "\n".join(lines) + "\n" for name, lines in files.items()}
        lines = robot.text.splitlines(keepends=True)
        light = [one for one in lines if not one.startswith(("mass_kg", "centre_of_mass_m"))]
        files |= {"robot.toml": "".join(light), "campaign.toml": self._toml()}
        return {name: text.encode() for name, text in files.items()}

    def _lost(self, q, tau):
        """Lost motion of joint 3, taken up within 60 N m."""
        return self.lost * np.tanh(tau / 60.0) * (np.arange(len(tau)) == 2)

    def _toml(self):
        tool = {"load_point": LOAD_POINT.tolist()}
        tool |= {f"P{k}": at.tolist() for k, at in enumerate(TOOL, 1)}
        tables = {"base_frame": BASE, "anchors": self.stated, "tool": tool}
        text = "\n".join(
            f"[{table}]\n" + "\n".join(f"{name} = {list(at)}" for name, at in own.items()) + "\n"
            for table, own in tables.items()
        )
        return f"""format = 1
name = "anchored"
robot = "robot.toml"

[tracker]
files = ["tracker.csv"]
sigma_m = {self.noise}

[scale]
sigma_n = 2.0

{text}
[tool_uncertainty]
sigma_m = 1.0e-4
"""
