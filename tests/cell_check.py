"""Check that a pose is free, with Pinocchio, coal and ray tests, from the robot file itself.

Nothing here is taken from the package except the robot file and its model for Pinocchio.
"""

import itertools
import tomllib

import coal
import numpy as np
import pinocchio as pin

from bench.as_pinocchio import model

CELL = {
    "tracker_m": [5.0, 7.5, 1.2],
    "floor_z_m": -0.891,
    "max_turn_deg": {"theta5": 200.0, "theta7": 270.0},
}
TOOL = {
    "load_point": [0.15, 0.0, 0.25],
    "P1": [0.15, 0.0, 0.1],
    "P2": [-0.075, 0.1299, 0.1],
    "P3": [-0.075, -0.1299, 0.1],
    "acceptance": {
        "P1": {"direction": [0.2, 0.0, 1.0], "half_angle_deg": 40.0},
        "P2": {"direction": [0.0, 0.0, 1.0], "half_angle_deg": 50.0},
        "P3": {"direction": [0.0, 0.0, 3.0], "half_angle_deg": 50.0},
    },
    "capsules": [{"from": [0.05, 0.0, 0.03], "to": [0.05, 0.0, 0.21], "radius": 0.09}],
}
"""A cell beside the rail, and an effector whose reflectors face away from the flange. P1 and the
load point are on its body, P2 and P3 are free-standing."""


class Checked:
    """A robot in a cell, for one pose at a time."""

    def __init__(self, robot, cell, tool, hulls=None):
        self.robot, self.cell, self.tool = robot, cell, tool
        self.built = model(robot)
        self.data = self.built.createData()
        rows = tomllib.loads(robot.text).get("capsules", [])
        rows = [(row["link"], row["from"], row["to"], row["radius"]) for row in rows]
        if hulls is not None:  # for a robot whose file has none
            names = ["base", *(joint.name for joint in robot.joints)]
            both = zip(hulls.carrier, hulls.ends[0], hulls.ends[1], hulls.radius, strict=True)
            rows = [(names[c], a, b, r) for c, a, b, r in both]
        inside = [("flange", c["from"], c["to"], c["radius"]) for c in tool.get("capsules", [])]
        self.rows = rows + inside
        self.radius = np.array([row[3] for row in self.rows])
        self.own = np.array([row[1:3] for row in self.rows], float)  # ends, in their links' frames
        self.shapes = [coal.Capsule(r, np.linalg.norm(b - a)) for (a, b), r in self.hulls()]
        self.upright = np.array([upright(b - a) for (a, b), _ in self.hulls()])
        self.order = {"base": 0, **{j.name: k for k, j in enumerate(robot.joints, 1)}}
        self.order["flange"] = robot.n
        zero = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        self.pairs = []
        ranks = sorted({self.order[row[0]] for row in self.rows})
        for i, j in itertools.combinations(range(len(self.rows)), 2):
            one, other = (ranks.index(self.order[self.rows[k][0]]) for k in (i, j))
            if abs(one - other) > 1:
                self.pairs.append((i, j))
        self.touching_at_zero = {p for p in self.pairs if self.apart(zero, p) <= 0}
        self.watched = [one for one in self.pairs if one not in self.touching_at_zero]

    def frame(self, link):
        """Frame of a link at the current pose."""
        if link == "base":
            return pin.SE3.Identity()
        if link == "flange":
            return self.data.oMf[self.built.getFrameId("flange")]
        return self.data.oMi[self.built.getJointId(link)]

    def hulls(self):
        """Ends and radius of each capsule."""
        return zip(self.own, self.radius, strict=True)

    def set(self, q):
        """Set a pose: `at` has both ends of every capsule in F_b, (k, 2, 3)."""
        pin.framesForwardKinematics(self.built, self.data, np.asarray(q, float))
        frames = {link: self.frame(link) for link in {row[0] for row in self.rows}}
        here = [frames[row[0]] for row in self.rows]
        turned = np.array([one.rotation for one in here])
        self.turned = turned @ self.upright
        self.at = np.einsum("kij,kej->kei", turned, self.own)
        self.at += np.array([one.translation for one in here])[:, None]

    def ends(self, k):
        """Both ends of a capsule in F_b."""
        return self.at[k]

    def shape(self, k):
        """A coal capsule with its transform."""
        return self.shapes[k], coal.Transform3s(self.turned[k], self.at[k].mean(axis=0))

    def apart(self, q, pair):
        """Distance of two capsules by coal, negative if they overlap."""
        self.set(q)
        return self.between(pair)

    def near(self, pairs):
        """Pairs whose bounding spheres overlap: only these can touch."""
        i, j = np.array(pairs).T
        half = np.linalg.norm(self.at[:, 1] - self.at[:, 0], axis=1) / 2 + self.radius
        off = np.linalg.norm(self.at[i].mean(axis=1) - self.at[j].mean(axis=1), axis=1)
        return [pair for pair, may in zip(pairs, off < half[i] + half[j], strict=True) if may]

    def between(self, pair):
        """The same at the current pose."""
        found = coal.DistanceResult()
        shapes = [one for k in pair for one in self.shape(k)]
        return coal.distance(*shapes, coal.DistanceRequest(), found)

    def point(self, name):
        """A point of the effector in F_b."""
        return self.frame("flange").act(np.array(self.tool[name], float))

    def loaded(self, q, force):
        """Joint values under the pull: each deflects by its compliance times its torque."""
        pin.computeJointJacobians(self.built, self.data, q)
        self.set(q)
        at = self.point("load_point")
        J = pin.getFrameJacobian(
            self.built, self.data, self.built.getFrameId("flange"), pin.LOCAL_WORLD_ALIGNED
        )
        lever = at - self.frame("flange").translation
        torque = J[:3].T @ force + J[3:].T @ np.cross(lever, force)
        return q + self.robot.nominal_compliance * torque

    def complaints(self, q, anchor, force_n):
        """Every violation of a pose, unloaded and loaded, in words."""
        q = np.asarray(q, float)
        out = [
            f"{name} turns too far"
            for name, most in self.cell.get("max_turn_deg", {}).items()
            if abs(q[self.order[name] - 1]) > np.deg2rad(most) + 1e-9
        ]
        self.set(q)
        pull = np.asarray(anchor, float) - self.point("load_point")
        bent = self.loaded(q, force_n * pull / np.linalg.norm(pull))
        out += [f"unloaded: {one}" for one in self._shots(q)]
        out += [f"loaded: {one}" for one in self._shots(bent)]
        out += [
            f"{self.rows[i][0]} in {self.rows[j][0]}"
            for i, j in self.pairs
            if (i, j) not in self.touching_at_zero and self.apart(q, (i, j)) < -1e-6
        ]
        self.set(q)
        out += self._lines(anchor)
        return out + self._low()

    def _shots(self, q):
        """Reflectors seen by the tracker outside their acceptance angle."""
        self.set(q)
        R = self.frame("flange").rotation
        for name, one in self.tool.get("acceptance", {}).items():
            beam = np.array(self.cell["tracker_m"]) - self.point(name)
            faced = R @ np.array(one["direction"])
            sine = np.linalg.norm(np.cross(beam, faced))
            if np.rad2deg(np.arctan2(sine, beam @ faced)) > one["half_angle_deg"]:
                yield f"{name} beyond its acceptance"

    def _lines(self, anchor):
        """Capsules crossed by beams or chain, if the line starts outside them."""
        out = []
        for name in (n for n in self.tool if n not in ("acceptance", "capsules")):
            end = anchor if name == "load_point" else self.cell["tracker_m"]
            p, e = self.point(name), np.array(end, float)
            for k in self._along(p, e):
                link, *_, radius = self.rows[k]
                own = self.order[link] == self.robot.n
                if own and off_segment(p, *self.ends(k)) <= radius + 0.01905:
                    if digs_in(p, e, *self.ends(k)):
                        out.append(f"line from {name} into {link}")
                elif hit(p, e, *self.ends(k), radius - 1e-6):
                    out.append(f"line from {name} through {link}")
        return out

    def _along(self, p, e):
        """Capsules whose bounding sphere is within a reflector's size of the line."""
        a, b = self.at[:, 0], self.at[:, 1]
        middle = (a + b) / 2 - p
        share = np.clip(middle @ (e - p) / ((e - p) @ (e - p)), 0, 1)
        off = np.linalg.norm(middle - share[:, None] * (e - p), axis=1)
        reach = np.linalg.norm(b - a, axis=1) / 2 + self.radius + 0.01905
        return np.flatnonzero(off <= reach + 1e-6)

    def _low(self):
        floor = self.cell.get("floor_z_m")
        if floor is None:
            return []
        low = [
            f"{self.rows[k][0]} in the floor"
            for k in range(len(self.rows))
            if self.order[self.rows[k][0]] > 2  # base, carriage and carousel stand on it
            and min(p[2] for p in self.ends(k)) - self.rows[k][3] < floor - 1e-6
        ]
        names = [n for n in self.tool if n not in ("acceptance", "capsules")]
        return low + [f"{n} in the floor" for n in names if self.point(n)[2] < floor]


def upright(along):
    """A rotation of z, the axis of coal's capsules, to this direction."""
    z = along / np.linalg.norm(along) if along.any() else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, [1.0, 0, 0] if abs(z[0]) < 0.9 else [0, 1.0, 0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def off_segment(p, a, b):
    """Distance of a point from a segment."""
    long = (b - a) @ (b - a)
    share = np.clip((p - a) @ (b - a) / long, 0, 1) if long else 0.0
    return float(np.linalg.norm(a + share * (b - a) - p))


def digs_in(p, e, a, b):
    """Whether a line approaches a segment in its first tenth of a millimetre."""
    ahead = p + 1e-4 * (e - p) / np.linalg.norm(e - p)
    return off_segment(ahead, a, b) < off_segment(p, a, b) - 1e-9


def hit(p, e, a, b, r):
    """Whether the ray from p to e enters a capsule: roots of cylinder and of both spheres."""
    reach = np.linalg.norm(e - p)
    d, ba, oa = (e - p) / reach, b - a, p - a
    long, bd, bo, do = ba @ ba, ba @ d, ba @ oa, d @ oa
    A, B, C = long - bd**2, long * do - bo * bd, long * (oa @ oa) - bo**2 - r**2 * long
    disc = B * B - A * C
    if A > 1e-12 and disc >= 0:
        for t in ((-B - np.sqrt(disc)) / A, (-B + np.sqrt(disc)) / A):
            if 0 < t < reach and 0 < bo + t * bd < long:
                return True
    for c in (a, b):
        half, rest = d @ (p - c), (p - c) @ (p - c) - r**2
        if half**2 >= rest:
            roots = -half - np.sqrt(half**2 - rest), -half + np.sqrt(half**2 - rest)
            if any(0 < t < reach for t in roots):
                return True
    return False
