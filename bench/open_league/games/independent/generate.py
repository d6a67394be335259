"""Campaigns of an independent forward model: robots, laws, noise and procedure of its own.

It shares nothing with the rest of the repository but the file forms of docs/campaign.md and
docs/open-league.md. A robot is a chain of 4x4 matrices with elastic elements between them. The
loaded state is the fixed point of "amplitude of each element = its law of the load that acts on
it where everything then stands", with full rotations and the pull aimed anew.

    python generate.py league OUT --count 60 [--seed 123]  # games with truth.json, OUT-notes.json
    python generate.py tables OUT --count 40 [--seed 123]  # rough tables, truth.json beside
    python generate.py clean  OUT                          # no noise, no roughness, no secret
"""

import argparse
import json
import math
import secrets
import time
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

TARGETS = ("P1", "P2", "P3")
DEG = math.pi / 180.0


# ---------------------------------------------------------------- rigid motions


def turn(axis, angle):
    """4x4 rotation about an axis through the origin, Rodrigues' formula."""
    a = np.asarray(axis, float)
    a = a / np.linalg.norm(a)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    t = np.eye(4)
    t[:3, :3] += math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k)
    return t


def shift(v):
    """4x4 translation."""
    t = np.eye(4)
    t[:3, 3] = v
    return t


def rpy(deg):
    """Rotation about fixed x, then y, then z."""
    r, p, y = (d * DEG for d in deg)
    return turn((0, 0, 1), y) @ turn((0, 1, 0), p) @ turn((1, 0, 0), r)


# ---------------------------------------------------------------- robots


@dataclass
class Robot:
    """A table of frames: kind, alpha [deg], a [m], theta [deg], d [m], low, high, k per row."""

    name: str
    convention: str
    base: tuple
    rows: list
    payload: float
    pull: float  # largest pull, N
    tool: dict
    upper: int  # row behind which the upper arm is
    fore: int
    wrist: tuple
    heave: int  # joint that a balancer would carry

    @property
    def rail(self):
        """Whether the first row slides."""
        return self.rows[0][0] == "p"

    @property
    def names(self):
        """Names of the joints, as in the files."""
        return [("r" if r[0] == "p" else "theta") + str(i + 1) for i, r in enumerate(self.rows)]


def robots():
    """Four machines that no maker sells."""
    return {
        "longrail6": Robot(
            "longrail6",
            "craig",
            ((0.0, 0.0, 0.0), (-90.0, 0.0, 0.0)),
            [
                ("p", 0, 0, 0, 0, 0.0, 18.0, 6.2e7),
                ("r", 90, 0, 0, 1.045, -175, 175, 2.5e6),
                ("r", -90, 0.41, -90, 0, -65, 75, 3.3e6),
                ("r", 0, 1.15, 0, 0, -110, 75, 2.1e6),
                ("r", -90, -0.055, 0, 1.22, -180, 180, 5.6e5),
                ("r", 90, 0, 0, 0, -118, 118, 4.4e5),
                ("r", -90, 0, 0, 0.23, -180, 180, 3.1e5),
            ],
            240.0,
            2400.0,
            {
                "load": (0.12, -0.07, 0.21),
                "P1": (0.19, 0.03, 0.1),
                "P2": (-0.13, 0.16, 0.08),
                "P3": (-0.08, -0.19, 0.2),
            },
            3,
            5,
            (5, 6),
            3,
        ),
        "floor6": Robot(
            "floor6",
            "standard",
            ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            [
                ("r", -90, 0.28, 0, 0.565, -170, 170, 9.5e5),
                ("r", 0, 0.94, -90, 0, -65, 85, 1.15e6),
                ("r", -90, 0.16, 0, 0, -90, 70, 7.2e5),
                ("r", 90, 0, 0, 0.98, -180, 180, 1.7e5),
                ("r", -90, 0, 0, 0, -115, 115, 1.3e5),
                ("r", 0, 0, 0, 0.155, -180, 180, 8.8e4),
            ],
            70.0,
            820.0,
            {
                "load": (-0.09, 0.06, 0.16),
                "P1": (0.15, 0.02, 0.07),
                "P2": (-0.1, 0.13, 0.05),
                "P3": (-0.07, -0.14, 0.15),
            },
            2,
            4,
            (4, 5),
            2,
        ),
        "heavy6": Robot(
            "heavy6",
            "standard",
            ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            [
                ("r", -90, 0.5, 0, 1.03, -175, 175, 4.6e6),
                ("r", 0, 1.31, -90, 0, -60, 70, 5.4e6),
                ("r", -90, -0.06, 0, 0, -95, 60, 4.1e6),
                ("r", 90, 0, 0, 1.52, -180, 180, 1.15e6),
                ("r", -90, 0, 0, 0, -120, 120, 9.4e5),
                ("r", 0, 0, 0, 0.29, -180, 180, 7.3e5),
            ],
            500.0,
            4200.0,
            {
                "load": (0.17, 0.04, 0.27),
                "P1": (0.24, -0.05, 0.12),
                "P2": (-0.16, 0.2, 0.14),
                "P3": (-0.11, -0.22, 0.26),
            },
            2,
            4,
            (4, 5),
            2,
        ),
        "arm7": Robot(
            "arm7",
            "craig",
            ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            [
                ("r", 0, 0, 0, 0.34, -165, 165, 6.4e4),
                ("r", -90, 0, 0, 0, -110, 110, 6.1e4),
                ("r", 90, 0, 0, 0.46, -165, 165, 4.4e4),
                ("r", 90, 0, 0, 0, -115, 115, 4.2e4),
                ("r", -90, 0, 0, 0.44, -165, 165, 2.1e4),
                ("r", -90, 0, 0, 0, -115, 115, 1.6e4),
                ("r", 90, 0.02, 0, 0.13, -170, 170, 1.2e4),
            ],
            20.0,
            185.0,
            {
                "load": (0.07, 0.05, 0.1),
                "P1": (0.11, 0.01, 0.05),
                "P2": (-0.07, 0.1, 0.03),
                "P3": (-0.06, -0.11, 0.11),
            },
            3,
            5,
            (5, 6),
            2,
        ),
    }


# ---------------------------------------------------------------- the elastic machine


@dataclass
class Element:
    """Something that gives: a turn about, or a shift along, an axis in the frame at its place."""

    row: int  # 1-based row of the table; 0 is the base
    stage: str  # "axis": on the axis of that joint; "body": behind it, turning with it
    kind: str  # "turn" or "shift"
    axis: tuple
    law: object  # (load, context) -> amplitude
    at: tuple = (0.0, 0.0, 0.0)
    name: str = ""


@dataclass
class Machine:
    """What is really there."""

    robot: Robot
    k: np.ndarray
    table: np.ndarray  # true alpha, a, theta, d per row, rad and m
    tool: dict
    elements: list = field(default_factory=list)
    weights: list = field(
        default_factory=list
    )  # (row, point in its frame, kg): of links, where a secret needs them
    growth: object = None  # (time [s]) -> change of the table

    def layout(self):
        """Elements by their place in the chain."""
        out = {}
        for i, r in enumerate(self.robot.rows, 1):
            kind = "shift" if r[0] == "p" else "turn"
            k = self.k[i - 1]
            out.setdefault((i, "axis"), []).append(
                Element(i, "axis", kind, (0, 0, 1), lambda q, c, k=k: q / k, name=f"joint{i}")
            )
        for e in self.elements:
            out.setdefault((e.row, e.stage), []).append(e)
        return out

    def pose(self, q, amplitude, layout, now=0.0):
        """Frame of the flange, frames behind each row, and each element with axis and point."""
        xyz, ang = self.robot.base
        t = shift(xyz) @ rpy(ang)
        table = self.table if self.growth is None else self.table + self.growth(now)
        seen, frames = [], [t]

        def give(t, key):
            for e in layout.get(key, ()):
                axis = t[:3, :3] @ np.asarray(e.axis, float)
                point = (t @ np.append(e.at, 1.0))[:3]
                seen.append((e, axis, point, len(frames) - 1))
                x = amplitude[len(seen) - 1]
                if e.kind == "turn":
                    t = t @ shift(e.at) @ turn(e.axis, x) @ shift(-np.asarray(e.at))
                else:
                    t = t @ shift(np.asarray(e.axis, float) * x)
            return t

        t = give(t, (0, "body"))
        for i, r in enumerate(self.robot.rows, 1):
            alpha, a, theta, d = table[i - 1]
            if r[0] == "p":
                d = d + q[i - 1]
            else:
                theta = theta + q[i - 1]
            link = shift((a, 0, 0)) @ turn((1, 0, 0), alpha)
            if self.robot.convention == "craig":
                t = give(t @ turn((1, 0, 0), alpha) @ shift((a, 0, 0)), (i, "axis"))
                t = t @ turn((0, 0, 1), theta) @ shift((0, 0, d))
                t = give(t, (i, "body"))
            else:
                t = give(t, (i, "axis"))
                t = t @ turn((0, 0, 1), theta) @ shift((0, 0, d))
                t = give(t, (i, "body")) @ link
            frames.append(t)
        return t, frames, seen

    def settle(self, q, pull=0.0, anchor=None, force=None, extra=None, context=None):
        """Equilibrium: flange, load point, force; a pull is aimed from where the point then is."""
        layout = self.layout()
        n = sum(len(v) for v in layout.values())
        x = np.zeros(n)
        context = dict(context or {})
        now = context.get("time", 0.0)
        for _ in range(80):
            t, frames, seen = self.pose(q, x, layout, now)
            point = (t @ np.append(self.tool["load"], 1.0))[:3]
            if anchor is not None and pull:
                u = (anchor - point) / np.linalg.norm(anchor - point)
                f = pull * u
            else:
                f = np.zeros(3) if force is None else np.asarray(force, float)
            whole = f if extra is None else f + extra
            acting = [(99, point, whole)]
            for row, at, kg in self.weights:
                acting.append(
                    (row, (frames[row] @ np.append(at, 1.0))[:3], np.array([0, 0, -9.80665 * kg]))
                )
            load = np.zeros(n)
            for j, (e, axis, o, level) in enumerate(seen):
                for row, where, g in acting:
                    if row > level:
                        load[j] += axis @ np.cross(where - o, g) if e.kind == "turn" else axis @ g
            context["load"] = {e.name: load[j] for j, (e, *_) in enumerate(seen)}
            context["q"] = q
            new = np.array([e.law(load[j], context) for j, (e, *_) in enumerate(seen)])
            step = np.max(np.abs(new - x))
            x = new
            if step < 1e-13:
                break
        t, _, seen = self.pose(q, x, layout, now)
        if context.get("memory") is not None:
            context["memory"].update(context.get("next", {}))
        return t, (t @ np.append(self.tool["load"], 1.0))[:3], f


# ---------------------------------------------------------------- the day in the cell


@dataclass
class Day:
    """Everything that a campaign needs beside the machine; secrets change it."""

    rng: np.random.Generator
    noise: str
    sigma: float
    families: dict = field(default_factory=dict)
    shown: object = None  # (true force, context) -> reading of the scale without noise
    along: object = None  # (context) -> more force on the load point, N
    line: np.ndarray | None = None  # Pl1 off the line of the pull, in the tool
    base_turn: np.ndarray | None = None
    drift: np.ndarray | None = None  # m/s
    slip: object = None  # (target, context) -> shift in the tool
    stated_load: np.ndarray | None = None
    rows: object = None  # blunders: (rows, loads, notes) -> None
    zero_after: bool = False
    joint_error: float = 0.0
    exact: bool = False


def rounded(v, digits):
    """A number as an export prints it."""
    return f"{v:.{digits}f}"


def toml_list(v):
    """A list of numbers."""
    return "[" + ", ".join(repr(round(float(x), 9)) for x in v) + "]"


def robot_file(robot, lengths=None, angles=None):
    """The table as the operator has it."""
    out = [
        "format = 1",
        f'name = "{robot.name}"',
        f'description = "{robot.name}, a machine of this generator"',
        'source = "drawn by hand"',
        "assumptions = []",
        f'convention = "{robot.convention}"',
        f"payload_kg = {robot.payload}",
    ]
    if lengths:
        out.append(f"length_sigma_m = {lengths}")
    if angles:
        out.append(f"angle_sigma_deg = {angles}")
    out += [
        "",
        "[base]",
        f"xyz_m = {list(map(float, robot.base[0]))}",
        f"rpy_deg = {list(map(float, robot.base[1]))}",
    ]
    for i, (kind, alpha, a, theta, d, low, high, k) in enumerate(robot.rows, 1):
        out += ["", "[[joint]]", f'name = "{robot.names[i - 1]}"']
        unit = "m" if kind == "p" else "deg"
        out += [
            f'type = "{"prismatic" if kind == "p" else "revolute"}"',
            f"lower_{unit} = {float(low)}",
        ]
        out += [
            f"upper_{unit} = {float(high)}",
            f"stiffness_{'n_per_m' if kind == 'p' else 'nm_per_rad'} = {k:.1f}",
        ]
        out += [
            f"alpha_deg = {float(alpha)}",
            f"theta_deg = {float(theta)}",
            f"a_m = {float(a)}",
            f"d_m = {float(d)}",
        ]
    return "\n".join(out) + "\n"


def nominal_table(robot):
    """Alpha, a, theta, d per row, in rad and m."""
    return np.array([[r[1] * DEG, r[2], r[3] * DEG, r[4]] for r in robot.rows])


def draw_pose(machine, rng):
    """Joint values with the tool off the floor and not inside the foot."""
    robot = machine.robot
    reach = 1.0 if robot.payload > 30 else 0.35
    for _ in range(5000):
        q = np.array(
            [rng.uniform(r[5], r[6]) * (1 if r[0] == "p" else 0.93 * DEG) for r in robot.rows]
        )
        if robot.rail:
            q[0] = rng.uniform(0.8, 17.2)
        t, _, _ = machine.pose(q, np.zeros(999), machine.layout())
        p = (t @ np.append(machine.tool["load"], 1.0))[:3]
        foot = np.array([0.0, q[0] if robot.rail else 0.0])
        if p[2] > 0.35 * reach + 0.1 and np.linalg.norm(p[:2] - foot) > 0.55 * reach:
            return q, p
    raise RuntimeError("no pose")


def aim(p, robot, rng):
    """An eye bolt in floor or column, 1 to 2.6 m from the load point."""
    scale = 1.0 if robot.payload > 30 else 0.6
    for _ in range(1000):
        v = rng.normal(size=3)
        v[2] = v[2] * 0.8 - 0.5
        a = p + v / np.linalg.norm(v) * rng.uniform(1.3, 2.6) * scale
        if a[2] > 0.02:
            return a
    raise RuntimeError("no anchor")


def flicker(times, rng):
    """Slow wander of unit variance: first-order processes of 30 s, 5 min and 50 min."""
    out = np.zeros((len(times), 3))
    for tau in (30.0, 300.0, 3000.0):
        x = rng.normal(size=3)
        last = times[0]
        for i, t in enumerate(times):
            r = math.exp(-(t - last) / tau)
            x = r * x + math.sqrt(max(1 - r * r, 0)) * rng.normal(size=3)
            out[i] += x / math.sqrt(3)
            last = t
    return out


def measure(folder, machine, day, poses, name, test, sigmas=True, lengths=None, angles=None):
    """The afternoon: reads in the operator's order, writes the folder, returns the truth."""
    rng, robot = day.rng, machine.robot
    nominal = robot.tool
    station = np.array(
        [rng.uniform(3.5, 6) * rng.choice([-1, 1]), rng.uniform(-2, 3), rng.uniform(0.9, 1.6)]
    )
    if robot.rail:
        station = np.array(
            [rng.uniform(5, 8) * rng.choice([-1, 1]), rng.uniform(6, 12), rng.uniform(1.0, 1.9)]
        )
    frame = rpy((rng.normal(0, 0.4), rng.normal(0, 0.4), rng.uniform(-180, 180)))[:3, :3]
    if robot.rail:
        base = {
            "B1": (0.9, -0.7, 0.1),
            "B2": (0.85, 18.8, 0.12),
            "B3": (-1.1, 17.9, 0.09),
            "B4": (-1.0, -0.4, 0.6),
            "B5": (1.3, 9.2, 0.05),
        }
    else:
        base = {
            "B1": (1.6, -1.4, 0.05),
            "B2": (1.5, 1.7, 0.06),
            "B3": (-1.7, 1.5, 0.9),
            "B4": (-1.4, -1.6, 0.07),
        }
    base = {b: np.array(v) + rng.normal(0, 0.03, 3).round(4) for b, v in base.items()}
    real_base = {b: v + (0 if day.exact else rng.normal(0, 1.5e-5, 3)) for b, v in base.items()}
    if day.base_turn is not None:
        n = np.linalg.norm(day.base_turn)
        r = turn(day.base_turn / n, n)[:3, :3]
        mid = np.mean(list(real_base.values()), axis=0)
        real_base = {b: mid + r @ (v - mid) for b, v in real_base.items()}
    clock = [0.0]
    rows, loads, joints = [], [], []

    def read(group, target, p):
        clock[0] += rng.uniform(5, 14)
        rows.append([group, target, np.array(p, float), clock[0]])

    def read_base(group):
        order = list(real_base)
        rng.shuffle(order)
        for b in order:
            read(group, b, real_base[b])

    order = list(range(len(poses)))
    if rng.random() < 0.6:
        order.sort(key=lambda i: poses[i]["q"][0])
    half = len(order) // 2
    read_base("base_start")
    judge = []
    number = {}
    for n, i in enumerate(order):
        p = poses[i]
        number[i] = n + 1
        if n == half:
            read_base("base_mid")
        clock[0] += rng.uniform(120, 320)
        q = p["q"].copy()
        shown_q = q.copy()
        err = rng.normal(size=len(q)) * day.joint_error
        err[[r[0] == "p" for r in robot.rows]] = 0.0
        digits = [6 if r[0] == "p" else 4 for r in robot.rows]
        shown = [
            rounded(v if r[0] == "p" else v / DEG, g)
            for v, r, g in zip(shown_q, robot.rows, digits, strict=True)
        ]
        q = (
            np.array(
                [
                    float(s) if r[0] == "p" else float(s) * DEG
                    for s, r in zip(shown, robot.rows, strict=True)
                ]
            )
            + err
        )
        joints.append((n + 1, *shown, p["approach"]))
        memory = {}
        tag = f"pose{n + 1:02d}"

        def points(t, context, machine=machine):
            out = {}
            for m in TARGETS:
                off = machine.tool[m] + (day.slip(m, context) if day.slip else 0.0)
                out[m] = (t @ np.append(off, 1.0))[:3]
            return out

        context = {
            "pose": n,
            "time": clock[0],
            "approach": p["approach"],
            "branch": "zero",
            "memory": memory,
            "rep": 0,
            "force": 0.0,
            "force_max": robot.pull,
        }
        t, _, _ = machine.settle(q, context=context)
        zero = points(t, context)
        targets = list(TARGETS)
        rng.shuffle(targets)
        for m in targets:
            read(f"{tag}_rep0_unloaded", m, zero[m])
        start = clock[0]
        before = 0.0
        for rep, part in enumerate(p["steps"], 1):
            clock[0] += rng.uniform(45, 120)
            f = robot.pull * part * (1 + rng.normal(0, 0.012))
            branch = "up" if f > before else "down"
            before = f
            context = {
                "pose": n,
                "time": clock[0],
                "since": clock[0] - start,
                "approach": p["approach"],
                "branch": branch,
                "memory": memory,
                "rep": rep,
                "force": f,
                "force_max": robot.pull,
            }
            extra = day.along(context) if day.along else None
            t, point, vec = machine.settle(q, f, p["anchor"], extra=extra, context=context)
            reading = day.shown(f, context) if day.shown else f
            reading += 0 if day.exact else rng.normal(0, p["sigma_n"])
            loads.append([n + 1, rep, reading, branch])
            u = (p["anchor"] - point) / np.linalg.norm(p["anchor"] - point)
            l1 = point + u * p["l1"]
            if day.line is not None:
                l1 = l1 + t[:3, :3] @ day.line
            now = points(t, context)
            rng.shuffle(targets)
            both = [(m, now[m]) for m in targets] + [("Pl1", l1), ("Pl2", point + u * p["l2"])]
            if rng.random() < 0.3:
                both = both[-2:] + both[:-2]
            for m, x in both:
                read(f"{tag}_rep{rep}_loaded", m, x)
            judge.append((q, vec, {m: now[m] - zero[m] for m in TARGETS}))
        if day.zero_after:
            clock[0] += rng.uniform(40, 90)
            context = {
                "pose": n,
                "time": clock[0],
                "approach": p["approach"],
                "branch": "after",
                "memory": memory,
                "rep": 9,
                "force": 0.0,
                "force_max": robot.pull,
            }
            t, _, _ = machine.settle(q, context=context)
            now = points(t, context)
            for m in targets:
                read(f"{tag}_rep0_unloaded", m, now[m])
    clock[0] += 90
    read_base("base_end")
    # into the instrument's frame, and noise
    slow = flicker([r[3] for r in rows], rng) * day.families.get("wander", 0.0)
    for i, r in enumerate(rows):
        x = frame @ (r[2] - station)
        if day.drift is not None:
            x = x + day.drift * r[3]
        if not day.exact:
            if day.noise == "normal":
                x = x + rng.normal(0, day.sigma, 3)
            elif day.noise.startswith("Student"):
                x = x + rng.standard_t(4, 3) * day.sigma / math.sqrt(2.0)
            elif day.noise == "1/f":
                x = x + rng.normal(0, day.sigma, 3) + slow[i]
            else:
                s = np.linalg.norm(x)
                b = x / s
                v = day.families
                x = (
                    x
                    + b * rng.normal(0, math.hypot(v["range_m"], v["range_per_m"] * s))
                    + (np.eye(3) - np.outer(b, b))
                    @ rng.normal(0, math.hypot(v["transverse_m"], v["transverse_per_m"] * s), 3)
                )
        r[2] = x
    notes = {}
    if day.rows is not None:
        day.rows(rows, loads, notes)
    folder.mkdir(parents=True)
    begin = datetime(2026, 5, 4, 7, 0) + timedelta(
        days=int(rng.integers(0, 120)), minutes=int(rng.integers(0, 240))
    )
    spatial = (not day.exact) and rng.random() < 0.25
    # the zero after the pulls has a name of its own: the same name twice reads as a contradiction
    met = set()
    for r in rows:
        if r[0].endswith("rep0_unloaded"):
            if (r[0], r[1]) in met:
                r[0] = r[0].replace("rep0", "rep9")
            else:
                met.add((r[0], r[1]))
    digits = 7 if day.exact else int(rng.choice([3, 4]))
    out = []
    if spatial:
        out.append("// points as measured, mm")
        for g, m, x, _ in rows:
            out.append(f"A::{g}::{m}, " + ", ".join(rounded(v * 1e3, digits) for v in x))
    else:
        out.append("group,target,x_mm,y_mm,z_mm,time")
        for g, m, x, s in rows:
            out.append(
                f"{g},{m},"
                + ",".join(rounded(v * 1e3, digits) for v in x)
                + ","
                + (begin + timedelta(seconds=round(s))).isoformat()
            )
    (folder / "tracker.csv").write_text("\n".join(out) + "\n")
    fd = 6 if day.exact else (2 if robot.payload < 30 else 1)
    if any(v[3] == "down" for v in loads):
        (folder / "loads.csv").write_text(
            "pose,repeat,force_n,branch\n"
            + "".join(f"{a},{b},{rounded(f, fd)},{c}\n" for a, b, f, c in loads)
        )
    else:
        (folder / "loads.csv").write_text(
            "pose,repeat,force_n\n" + "".join(f"{a},{b},{rounded(f, fd)}\n" for a, b, f, _ in loads)
        )
    title = [
        n + ("_m" if r[0] == "p" else "_deg") for n, r in zip(robot.names, robot.rows, strict=True)
    ]
    way = robot.rail
    (folder / "joints.csv").write_text(
        ",".join(["pose", *title] + (["approach"] if way else []))
        + "\n"
        + "".join(",".join(map(str, j if way else j[:-1])) + "\n" for j in joints)
    )
    (folder / "robot.toml").write_text(robot_file(robot, lengths, angles))
    toml = [
        "format = 1",
        f'name = "{name}"',
        'robot = "robot.toml"',
        "",
        "[tracker]",
        'files = ["tracker.csv"]',
    ]
    if spatial:
        toml.append('unit = "mm"')
    if day.noise == "by distance":
        v = day.families
        toml.append(
            "noise = { "
            + ", ".join(
                f"{k} = {v[k]:.3g}"
                for k in ("range_m", "range_per_m", "transverse_m", "transverse_per_m")
            )
            + " }"
        )
    else:
        toml.append(f"sigma_m = {day.sigma:.3g}")
    toml += [
        "",
        "[naming]",
        'measured = ["P1", "P2", "P3"]',
        'chain = ["Pl1", "Pl2"]',
        "",
        "[base_frame]",
    ]
    toml += [f"{b} = {toml_list(v)}" for b, v in base.items()]
    toml += [
        "",
        "[scale]",
        'file = "loads.csv"',
        f"sigma_n = {poses[0]['sigma_n']:.4g}",
        "",
        "[joints]",
        'file = "joints.csv"',
        "",
        "[tool]",
    ]
    stated = np.array(nominal["load"]) if day.stated_load is None else day.stated_load
    toml.append(f"load_point = {toml_list(stated)}")
    toml += [f"{m} = {toml_list(nominal[m])}" for m in TARGETS]
    if not day.exact:
        toml += ["", "[tool_uncertainty]", "sigma_m = 5e-5"]
    toml += [
        "",
        "[test_pose]",
        "q = " + toml_list(test["q"]),
        "force_n = " + toml_list(test["force_n"]),
    ]
    (folder / "campaign.toml").write_text("\n".join(toml) + "\n")
    return {"displacements": judge, "notes": notes}


# ---------------------------------------------------------------- secrets


def play(memory_key, width):
    """Play operator: what follows lags by half a width; memory per pose."""

    def follow(x, c):
        m = c.get("memory") or {}
        last = m.get(memory_key, 0.0)
        now = min(max(last, x - width), x + width)
        c.setdefault("next", {})[memory_key] = now
        return now

    return follow


def smooth_sign(load, scale):
    """Sign of a load, smooth about zero."""
    return math.tanh(load / scale)


def listed(machine, day, rng):
    """One secret that docs/campaign.md names: (name, where, accept, amplitudes)."""
    robot = machine.robot
    n = len(robot.rows)
    c = 1 / machine.k
    small = robot.payload < 30
    turning = [i for i in range(1, n + 1) if robot.rows[i - 1][0] == "r"]
    top = torque_scale(robot)
    names = [
        "joint_tilt",
        "link_bending",
        "tool_flex",
        "joint_hardening",
        "joint_lost_motion",
        "joint_hysteresis",
        "compensator",
        "wrist_coupling",
    ]
    names += [
        "scale_zero",
        "scale_curvature",
        "chain_weight",
        "chain_offset",
        "joint_offset",
        "base_rotation",
        "tracker_drift",
        "gravity_sag",
    ]
    names += [
        "load_point_offset",
        "link_length",
        "link_offset",
        "link_twist",
        "outlier",
        "label_swap",
    ]
    if robot.rail:
        names += [
            "rail_roll",
            "rail_pitch",
            "rail_backlash",
            "rail_stiffness_varies",
            "rail_lateral",
        ] * 2
    name = str(rng.choice(names))
    add = machine.elements.append
    wide = float(rng.uniform(0.5, 1.6))

    def linear(x):
        return lambda q, ctx: q * x

    if name == "joint_tilt":
        j = int(rng.choice(turning))
        phi = rng.uniform(0, math.pi)
        x = wide * c[j - 1]
        place = "body"
        add(Element(j, place, "turn", (math.cos(phi), math.sin(phi), 0), linear(x), name="tilt"))
        accept = []
        if j == n:
            accept = ["tool_flex"]
        for a, b in (robot.wrist,):
            if j == a:
                accept.append(f"joint_tilt:{b}")
            if j == b:
                accept.append(f"joint_tilt:{a}")
        return name, j, accept, {"compliance": x}
    if name == "link_bending":
        which = str(rng.choice(["upper_arm", "forearm"]))
        row = robot.upper if which == "upper_arm" else robot.fore
        x = wide * c[row - 1]
        # its middle, in the frame behind the joint that carries it; across the link
        nxt = (
            machine.table[row]
            if robot.convention == "craig" and row < n
            else machine.table[row - 1]
        )
        along = (
            np.array([nxt[1], 0, 0])
            if abs(nxt[1]) > 0.3
            else np.array([0, 0, -machine.table[row - 1][3]])
        )
        axis = (0, 0, 1) if abs(nxt[1]) > 0.3 else (0, 1, 0)
        add(Element(row, "body", "turn", axis, linear(x), tuple(along / 2), name="bend"))
        accept = [f"joint_tilt:{row}", f"joint_tilt:{row + 1}"]
        return name, which, accept, {"compliance": x}
    if name == "tool_flex":
        v = rng.normal(size=3)
        v[2] *= 0.4
        x = wide * c[-1]
        machine.elements.append(
            Element(
                n, "body", "turn", tuple(v / np.linalg.norm(v)), linear(x), (0, 0, 0.0), name="tool"
            )
        )
        return name, None, [f"joint_tilt:{n}"], {"compliance": x}
    if name == "joint_hardening":
        j = int(rng.choice(turning))
        x = float(rng.uniform(0.35, 0.8)) * c[j - 1]
        t0 = top[j - 1]
        add(
            Element(
                j,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: x * q / (1 + (q / (0.5 * t0)) ** 2),
                name="hard",
            )
        )
        return name, j, [], {"compliance_at_rest": x, "torque": t0}
    if name == "joint_lost_motion":
        j = int(rng.choice(turning))
        b = float(rng.uniform(8e-5, 2.5e-4)) * (3 if small else 1)
        add(
            Element(
                j,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: b * smooth_sign(q, 0.03 * top[j - 1]),
                name="lost",
            )
        )
        return name, j, [], {f"b_{j}": b}
    if name == "joint_hysteresis":
        j = int(rng.choice(turning))
        f = float(rng.uniform(8e-5, 2.2e-4)) * (3 if small else 1)
        lag = play("hyst", f)
        k = machine.k[j - 1]
        add(
            Element(
                j, "axis", "turn", (0, 0, 1), lambda q, ctx: lag(q / k, ctx) - q / k, name="hyst"
            )
        )
        return name, j, [], {f"f_{j}": f}
    if name == "compensator":
        j = robot.heave
        x = float(rng.uniform(0.3, 0.7)) * c[j - 1]
        add(
            Element(
                j,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: x * (1 + math.cos(ctx["q"][j - 1])) / 2 * q,
                name="comp",
            )
        )
        return name, None, [], {"c_comp_cos": x / 2}
    if name == "wrist_coupling":
        a, b = robot.wrist
        x = float(rng.uniform(0.25, 0.6)) * math.sqrt(c[a - 1] * c[b - 1])
        add(
            Element(
                a,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: x * ctx["load"][f"joint{b}"],
                name="cpl1",
            )
        )
        add(
            Element(
                b,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: x * ctx["load"][f"joint{a}"],
                name="cpl2",
            )
        )
        return name, None, [], {"c": x}
    if name == "scale_zero":
        z = float(rng.uniform(0.008, 0.03)) * robot.pull * rng.choice([-1, 1])
        day.shown = lambda f, ctx: f + z
        return name, None, [], {"f_zero": z}
    if name == "scale_curvature":
        e = float(rng.uniform(0.012, 0.04)) * rng.choice([-1, 1])
        day.shown = lambda f, ctx: f * (1 + e * f / robot.pull)
        return name, None, [], {"e_scale": e}
    if name == "chain_weight":
        w = float(rng.uniform(0.012, 0.04)) * robot.pull
        day.along = lambda ctx: np.array([0, 0, -w])
        return name, None, [], {"w_chain": w}
    if name == "chain_offset":
        v = rng.normal(size=3)
        day.line = v / np.linalg.norm(v) * float(rng.uniform(0.006, 0.02))
        return name, None, [], {"offset_m": float(np.linalg.norm(day.line))}
    if name == "joint_offset":
        j = int(rng.choice(turning[:-1]))
        d = float(rng.uniform(0.004, 0.012)) * rng.choice([-1, 1])
        machine.table[j - 1][2] += d
        return name, j, twins(machine, j, 2), {"rad": d}
    if name in ("link_length", "link_offset", "link_twist"):
        col = {"link_length": 1, "link_offset": 3, "link_twist": 0}[name]
        rows = range(2, n) if not robot.rail else range(3, n)
        j = int(rng.choice(list(rows)))
        d = float(rng.uniform(0.005, 0.02)) * rng.choice([-1, 1])
        machine.table[j - 1][col] += d
        return name, j, twins(machine, j, col), {"m_or_rad": d}
    if name == "base_rotation":
        v = rng.normal(size=3)
        day.base_turn = v / np.linalg.norm(v) * float(rng.uniform(0.004, 0.012))
        return name, None, [], {"rad": float(np.linalg.norm(day.base_turn))}
    if name == "tracker_drift":
        v = rng.normal(size=3)
        day.drift = v / np.linalg.norm(v) * float(rng.uniform(2e-8, 8e-8))
        return name, None, [], {"m_per_s": float(np.linalg.norm(day.drift))}
    if name == "gravity_sag":
        m = robot.payload * float(rng.uniform(1.5, 4))
        row = robot.upper
        machine.weights.append((row + 1, (0.0, 0.0, 0.0), m))
        return name, None, [], {"kg": m}
    if name == "load_point_offset":
        v = rng.normal(size=3)
        day.stated_load = np.array(robot.tool["load"]) + v / np.linalg.norm(v) * float(
            rng.uniform(0.012, 0.04)
        ) * (0.5 if small else 1)
        return (
            name,
            None,
            [],
            {"m": float(np.linalg.norm(day.stated_load - np.array(robot.tool["load"])))},
        )
    if name == "outlier":
        size = float(rng.uniform(0.25, 2.0)) * 1e-3
        v = rng.normal(size=3)
        v *= size / np.linalg.norm(v)

        def spoil(rows, loads, notes):
            pick = [
                i
                for i, r in enumerate(rows)
                if r[0].startswith("pose") and r[0].endswith("_loaded") and r[1] in TARGETS
            ]
            i = int(rng.choice(pick))
            rows[i][2] = rows[i][2] + v
            notes["where"] = f"{rows[i][0]}/{rows[i][1]}"

        day.rows = spoil
        return name, "?", [], {"m": size}
    if name == "label_swap":

        def swap(rows, loads, notes):
            groups = sorted({r[0] for r in rows if r[0].endswith("_loaded")})
            g = str(rng.choice(groups))
            a, b = rng.choice(TARGETS, 2, replace=False)
            for r in rows:
                if r[0] == g and r[1] in (a, b):
                    r[1] = str(b) if r[1] == a else str(a)
            notes["where"] = g

        day.rows = swap
        return name, "?", [], {}
    scale = 8e-9 * (240.0 / robot.payload)
    if name == "rail_roll":
        x = wide * 1.6 * scale
        add(Element(0, "body", "turn", (0, 0, 1), linear(x), name="roll"))
        return name, None, [], {"c_roll": x}
    if name == "rail_pitch":
        x = wide * 1.6 * scale
        # the frame runs along the rail with the carriage: behind row 1
        add(Element(1, "body", "turn", (1, 0, 0), linear(x), name="pitch"))
        return name, None, [], {"c_pitch": x}
    if name == "rail_lateral":
        x = wide * 3e-8
        add(Element(1, "body", "shift", (1, 0, 0), linear(x), name="lateral"))
        return name, None, [], {"c_lateral": x}
    if name == "rail_backlash":
        b = float(rng.uniform(1e-4, 3e-4))

        def gap(q, ctx):
            if ctx["branch"] == "zero":
                return -b / 2 * ctx["approach"]
            return b / 2 * (math.tanh(q / 120.0) if abs(q) > 1e-9 else -ctx["approach"])

        add(Element(1, "axis", "shift", (0, 0, 1), gap, name="gap"))
        return name, None, [], {"b_rail": b}
    x = wide * 3.5e-8

    def slope(q, ctx):
        return q * x * ctx["q"][0] / 18.0

    add(Element(1, "axis", "shift", (0, 0, 1), slope, name="slope"))
    return "rail_stiffness_varies", None, [], {"c_rail_slope": x}


UNLISTED = (
    "gap_with_memory",
    "gear_ripple",
    "sleepers",
    "warm_link",
    "softening",
    "coupled_pair",
    "rubbing_chain",
    "creeping_scale",
    "foundation",
    "creeping_nest",
    "viscous_joint",
    "two_stage",
)


def unlisted(machine, day, rng):
    """One secret that docs/campaign.md does not name."""
    robot = machine.robot
    n = len(robot.rows)
    c = 1 / machine.k
    small = robot.payload < 30
    turning = [i for i in range(1, n + 1) if robot.rows[i - 1][0] == "r"]
    top = torque_scale(robot)
    add = machine.elements.append
    names = [
        u
        for u in UNLISTED
        if not (u == "sleepers" and not robot.rail) and not (u == "foundation" and robot.rail)
    ]
    name = str(rng.choice(names))
    big = turning[:4]
    if name == "gap_with_memory":
        j = int(rng.choice(turning))
        gap = float(rng.uniform(1.5e-4, 4e-4)) * (3 if small else 1)
        lag = play("gap", gap * 0.3)
        k = machine.k[j - 1]
        side = np.random.default_rng(int(rng.integers(2**31))).choice([-1, 1], 99)

        def law(q, ctx):
            # the tooth lies on one flank: only a pull the other way crosses the gap
            s = side[ctx["pose"]] if "pose" in ctx else 1
            cross = (
                gap * 0.5 * (1 + math.tanh(-s * q / (0.04 * top[j - 1])) * 1.0)
                if abs(q) > 0
                else 0.0
            )
            return (
                -s * cross * (0.0 if ctx.get("branch") == "zero" else 1.0) + lag(q / k, ctx) - q / k
            )

        add(Element(j, "axis", "turn", (0, 0, 1), law, name="gap"))
        return name, j, {"gap": gap}
    if name == "gear_ripple":
        j = int(rng.choice(turning))
        order = int(rng.integers(3, 30))
        part = float(rng.uniform(0.25, 0.6))
        phi = rng.uniform(0, 2 * math.pi)
        add(
            Element(
                j,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: part * c[j - 1] * q * math.cos(order * ctx["q"][j - 1] + phi),
                name="ripple",
            )
        )
        return name, j, {"part": part, "order": order}
    if name == "sleepers":
        pitch = float(rng.uniform(1.6, 3.4))
        x = float(rng.uniform(0.7, 2.0)) * 2e-8
        phi = rng.uniform(0, 2 * math.pi)
        add(
            Element(
                1,
                "body",
                "turn",
                (0, 0, 1),
                lambda q, ctx: x * q * (1 + math.cos(2 * math.pi * ctx["q"][0] / pitch + phi)) / 2,
                name="sleepers",
            )
        )
        return name, "rail", {"pitch": pitch, "c": x}
    if name == "warm_link":
        row = robot.upper + (1 if robot.convention == "craig" else 0)
        col = 1 if abs(machine.table[row - 1][1]) > 0.3 else 3
        size = float(rng.uniform(3e-4, 8e-4))
        tau = float(rng.uniform(2000, 7000))

        def grow(t):
            g = np.zeros_like(machine.table)
            g[row - 1, col] = size * (1 - math.exp(-t / tau))
            return g

        machine.growth = grow
        return name, row, {"m": size, "tau_s": tau}
    if name == "softening":
        j = int(rng.choice(big))
        part = float(rng.uniform(0.4, 1.0))
        add(
            Element(
                j,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: part * c[j - 1] * q * (q / top[j - 1]) ** 2,
                name="soft",
            )
        )
        return name, j, {"part": part}
    if name == "coupled_pair":
        pairs = [
            (a, b)
            for a in turning
            for b in turning
            if a < b and (a, b) != robot.wrist and b - a <= 2
        ]
        a, b = pairs[int(rng.integers(len(pairs)))]
        x = float(rng.uniform(0.25, 0.5)) * math.sqrt(c[a - 1] * c[b - 1]) * rng.choice([-1, 1])
        add(
            Element(
                a,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: x * ctx["load"][f"joint{b}"],
                name="cpl1",
            )
        )
        add(
            Element(
                b,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: x * ctx["load"][f"joint{a}"],
                name="cpl2",
            )
        )
        return name, f"{a}-{b}", {"c": x}
    if name == "rubbing_chain":
        mu = float(rng.uniform(0.02, 0.07))
        touched = np.random.default_rng(int(rng.integers(2**31))).random(99) < 0.5
        day.shown = lambda f, ctx: (
            f * (1 + mu * (1 if ctx["branch"] == "up" else -1)) if touched[ctx["pose"]] else f
        )
        return name, "chain", {"mu": mu}
    if name == "creeping_scale":
        e = float(rng.uniform(0.02, 0.05))
        tau = float(rng.uniform(100, 400))
        day.shown = lambda f, ctx: f * (1 - e * math.exp(-ctx["since"] / tau))
        return name, "scale", {"part": e, "tau_s": tau}
    if name == "foundation":
        x = float(rng.uniform(0.3, 1.0)) * c[1]
        phi = rng.uniform(0, math.pi)
        add(
            Element(
                0,
                "body",
                "turn",
                (math.cos(phi), math.sin(phi), 0),
                lambda q, ctx: x * q,
                (0.0, 0.0, -0.3),
                name="floor",
            )
        )
        return name, "floor", {"c": x}
    if name == "creeping_nest":
        m = str(rng.choice(TARGETS))
        v = rng.normal(size=3)
        v *= float(rng.uniform(1e-4, 3e-4)) / np.linalg.norm(v)
        day.slip = lambda t, ctx: v * (ctx["force"] / ctx["force_max"]) if t == m else np.zeros(3)
        return name, m, {"m": float(np.linalg.norm(v))}
    if name == "viscous_joint":
        j = int(rng.choice(big))
        part = float(rng.uniform(0.25, 0.6))
        tau = float(rng.uniform(80, 400))
        add(
            Element(
                j,
                "axis",
                "turn",
                (0, 0, 1),
                lambda q, ctx: part * c[j - 1] * q * (1 - math.exp(-ctx.get("since", 0.0) / tau)),
                name="creep",
            )
        )
        return name, j, {"part": part, "tau_s": tau}
    j = int(rng.choice(big))
    part = float(rng.uniform(0.5, 1.2))
    knee = float(rng.uniform(0.2, 0.45)) * top[j - 1]
    add(
        Element(
            j,
            "axis",
            "turn",
            (0, 0, 1),
            lambda q, ctx: part * c[j - 1] * math.copysign(max(abs(q) - knee, 0.0), q),
            name="stage",
        )
    )
    return "two_stage", j, {"part": part, "knee_nm": knee}


def torque_scale(robot):
    """About the largest torque of each joint under the hardest pull."""
    out = []
    span = sum(abs(r[2]) + abs(r[4]) for r in robot.rows[1:]) * 0.7
    for i in range(len(robot.rows)):
        rest = sum(abs(r[2]) + abs(r[4]) for r in robot.rows[i + 1 :])
        out.append(
            robot.pull * max(min(rest, span), 0.25 * (1 if robot.payload > 30 else 0.5)) * 0.8
        )
    return np.array(out)


def twins(machine, row, col, limit=0.9995):
    """Labels of entries of the table that move the reflectors as this one does, in every pose."""
    rng = np.random.default_rng(5)
    words = {0: "link_twist", 1: "link_length", 2: "joint_offset", 3: "link_offset"}
    poses = [draw_pose(machine, rng)[0] for _ in range(25)]
    layout = machine.layout()

    def stack(tab):
        keep, machine.table = machine.table, tab
        out = [
            (machine.pose(q, np.zeros(99), layout)[0] @ np.append(machine.tool[m], 1))[:3]
            for q in poses
            for m in TARGETS
        ]
        machine.table = keep
        return np.concatenate(out)

    start = machine.table
    zero = stack(start)
    column = {}
    for i in range(len(start)):
        for j in range(4):
            t = start.copy()
            t[i, j] += 1e-6
            column[i + 1, j] = stack(t) - zero
    me = column[row, col]
    out = []
    for (i, j), v in column.items():
        if (i, j) == (row, col) or np.linalg.norm(v) < 1e-12:
            continue
        if abs(v @ me) / np.linalg.norm(v) / np.linalg.norm(me) > limit:
            name = words[j]
            if machine.robot.rows[i - 1][0] == "p" and j == 3:
                name = "joint_offset"
            out.append(f"{name}:{i}")
    return out


# ---------------------------------------------------------------- campaigns


def plan(machine, rng, count, pattern):
    """Poses, pulls and anchors of a campaign."""
    poses = []
    robot = machine.robot
    for _ in range(count):
        q, p = draw_pose(machine, rng)
        poses.append(
            {
                "q": q,
                "anchor": aim(p, robot, rng),
                "steps": pattern,
                "approach": int(rng.choice([-1, 1])),
                "l1": rng.uniform(0.15, 0.3),
                "l2": rng.uniform(0.75, 1.1),
                "sigma_n": round(max(robot.pull * 0.001, 0.1), 3),
            }
        )
    return poses


def new_machine(robot, rng, rough_m=0.0, rough_rad=0.0, spread=0.2, tool=3e-5):
    """A machine of its type, with a table that is a little off."""
    k = np.array([r[7] for r in robot.rows]) * np.exp(rng.normal(0, spread, len(robot.rows)))
    table = nominal_table(robot)
    table[:, [1, 3]] += rng.normal(0, 1, (len(table), 2)) * rough_m
    table[:, [0, 2]] += rng.normal(0, 1, (len(table), 2)) * rough_rad
    points = {m: np.array(v) + rng.normal(0, 1, 3) * tool for m, v in robot.tool.items()}
    return Machine(robot, k, table, points)


def test_of(machine, rng):
    """A pose and a force that are not measured."""
    q, _ = draw_pose(machine, rng)
    robot = machine.robot
    v = rng.normal(size=3)
    force = v / np.linalg.norm(v) * robot.pull * float(rng.uniform(0.5, 0.9))
    shown = [round(v if r[0] == "p" else v / DEG, 4) for v, r in zip(q, robot.rows, strict=True)]
    return {"q": shown, "force_n": [round(float(x), 2) for x in force]}


def deflection(machine, test):
    """True deflection of every target [m]."""
    robot = machine.robot
    q = np.array(
        [v if r[0] == "p" else v * DEG for v, r in zip(test["q"], robot.rows, strict=True)]
    )
    memory = {}
    common = {
        "pose": 50,
        "time": 0.0,
        "since": 120.0,
        "approach": 1,
        "memory": memory,
        "force_max": robot.pull,
    }
    a, _, _ = machine.settle(q, context={**common, "branch": "zero", "force": 0.0, "rep": 0})
    b, _, _ = machine.settle(
        q,
        force=test["force_n"],
        context={
            **common,
            "branch": "up",
            "force": float(np.linalg.norm(test["force_n"])),
            "rep": 1,
        },
    )
    return {m: list(map(float, ((b - a) @ np.append(machine.tool[m], 1.0))[:3])) for m in TARGETS}


def visible(machine, judge, sigma):
    """What the best joint springs leave of the noise-free displacements: in sigma, and in mm."""
    plain = Machine(machine.robot, machine.k, machine.table, machine.tool)
    rows, rhs = [], []
    layout = plain.layout()
    for q, f, d in judge:
        t, _, seen = plain.pose(q, np.zeros(99), layout)
        load = (t @ np.append(plain.tool["load"], 1))[:3]
        for m in TARGETS:
            p = (t @ np.append(plain.tool[m], 1))[:3]
            cols = []
            for e, axis, o, _ in seen:
                if e.kind == "turn":
                    cols.append(np.cross(axis, p - o) * (axis @ np.cross(load - o, f)))
                else:
                    cols.append(axis * (axis @ f))
            rows.append(np.array(cols).T)
            rhs.append(d[m])
    a, b = np.vstack(rows), np.concatenate(rhs)
    s = np.linalg.norm(a, axis=0)
    x, *_ = np.linalg.lstsq(a / s, b, rcond=None)
    r = b - a / s @ x
    return float(np.linalg.norm(r) / (sigma * math.sqrt(2))), float(np.sqrt(np.mean(r**2)) * 1e3)


def set_noise(day, rng, kind):
    """Family and size of the noise."""
    day.noise = kind
    day.sigma = float(f"{rng.uniform(1.8e-5, 3.8e-5):.2g}")
    if kind == "1/f":
        day.families["wander"] = day.sigma * float(rng.uniform(0.7, 1.2))
    if kind == "by distance":
        day.families = {
            "range_m": float(rng.uniform(6e-6, 1.2e-5)),
            "range_per_m": 4e-7,
            "transverse_m": float(rng.uniform(6e-6, 1.2e-5)),
            "transverse_per_m": float(rng.uniform(2.5e-6, 4.5e-6)),
        }
        day.families = {k: float(f"{v:.3g}") for k, v in day.families.items()}


PATTERNS = ((0.4, 1.0, 0.65), (0.3, 0.6, 1.0, 0.6), (0.35, 0.7, 1.0, 0.5), (0.5, 1.0, 0.5))


def league(out, count, seed):
    """Games: kinds in turn, everything else drawn from one seed per game."""
    notes = []
    kinds = ["clean", "one cause", "outside the catalogue"]
    noises = ["normal", "Student t, 4", "1/f", "by distance"]
    for g in range(count):
        rng = np.random.default_rng([seed, g])
        robot = robots()[
            str(rng.choice(["longrail6", "floor6", "heavy6", "arm7"], p=[0.4, 0.2, 0.2, 0.2]))
        ]
        kind = kinds[g % 3]
        rough = float(rng.uniform(1e-4, 4e-4))
        machine = new_machine(robot, rng, rough, rough * 0.6)
        day = Day(rng, "normal", 3e-5)
        set_noise(day, rng, str(rng.choice(noises)))
        day.joint_error = float(rng.choice([0.0, 3e-5]))
        day.zero_after = bool(rng.random() < 0.6)
        poses = plan(
            machine, rng, int(rng.integers(14, 19)), PATTERNS[int(rng.integers(len(PATTERNS)))]
        )
        test = test_of(machine, rng)
        causes, private = [], {}
        if kind == "one cause":
            name, where, accept, size = listed(machine, day, rng)
            causes = [
                {"name": name, "where": where, "accept": accept, "listed": True, "amplitudes": size}
            ]
        elif kind != "clean":
            name, where, size = unlisted(machine, day, rng)
            causes = [
                {"name": name, "where": where, "accept": [], "listed": False, "amplitudes": size}
            ]
        name = f"game{g + 1:02d}"
        seen = measure(out / name, machine, day, poses, name, test)
        if causes and causes[0]["where"] == "?":
            causes[0]["where"] = seen["notes"]["where"]
        sigma = day.sigma if day.noise != "by distance" else 2.5e-5
        left, rms = visible(machine, seen["displacements"], sigma)
        private = {
            "game": name,
            "robot": robot.name,
            "kind": kind,
            "noise": day.noise,
            "sigma": sigma,
            "rough": rough,
            "causes": causes,
            "left_sigmas": left,
            "left_rms_mm": rms,
        }
        notes.append(private)
        truth = {
            "format": 1,
            "salt": secrets.token_hex(16),
            "kind": kind,
            "noise": day.noise,
            "stiffness": [
                {"name": "k_" + n, "value": float(v)}
                for n, v in zip(robot.names, machine.k, strict=True)
            ],
            "causes": causes,
            "predictions": [
                {
                    "name": "test_pose",
                    "q": test["q"],
                    "force_n": test["force_n"],
                    "deflection_m": deflection(machine, test),
                }
            ],
        }
        (out / name / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    (out.parent / f"{out.name}-notes.json").write_text(
        json.dumps({"seed": seed, "games": notes}, indent=1) + "\n"
    )


def tables(out, count, seed):
    """Robots as delivered, half of them with one entry far off."""
    words = {0: "link_twist", 1: "link_length", 2: "joint_offset", 3: "link_offset"}
    for g in range(count):
        rng = np.random.default_rng([seed, 7000 + g])
        robot = robots()[["longrail6", "floor6", "longrail6", "heavy6"][(g // 2) % 4]]
        rough = float(rng.uniform(2e-4, 1e-3))
        machine = new_machine(robot, rng, rough, rough)
        if robot.rail:
            machine.table[0, [0, 1, 2]] = nominal_table(robot)[0, [0, 1, 2]] + rng.normal(
                0, 1, 3
            ) * [rough, rough, rough]
        day = Day(rng, "normal", 3e-5)
        day.joint_error = float(rng.uniform(0, 3e-4))
        day.zero_after = bool(rng.random() < 0.5)
        causes = []
        if g % 2:
            rows = range(3 if robot.rail else 2, len(robot.rows))
            row = int(rng.choice(list(rows)))
            col = int(rng.integers(0, 4))
            size = float(rng.uniform(3e-3, 2e-2)) * float(rng.choice([-1, 1]))
            machine.table[row - 1, col] += size
            causes = [
                {"name": words[col], "where": row, "accept": twins(machine, row, col), "size": size}
            ]
        poses = plan(
            machine, rng, int(rng.integers(14, 19)), PATTERNS[int(rng.integers(len(PATTERNS)))]
        )
        test = test_of(machine, rng)
        name = f"table{g + 1:02d}"
        seen = measure(out / name, machine, day, poses, name, test)
        nominal = nominal_table(robot)
        left, rms = visible(machine, seen["displacements"], day.sigma)
        truth = {
            "robot": robot.name,
            "convention": robot.convention,
            "rough_m_and_rad": rough,
            "joint_error_rad": day.joint_error,
            "causes": causes,
            "stiffness": [
                {"name": "k_" + n, "value": float(v)}
                for n, v in zip(robot.names, machine.k, strict=True)
            ],
            "table_minus_nominal": {
                "columns": "alpha_rad, a_m, theta_rad, d_m",
                "rows": (machine.table - nominal).tolist(),
            },
            "test_pose": {**test, "deflection_m": deflection(machine, test)},
            "left_rms_mm_about_true_table": rms,
            "left_sigmas": left,
        }
        (out / name / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    (out / "SEED").write_text(f"{seed}\n")


def clean(out):
    """No noise, no roughness, no secret: what the other side must find exactly."""
    for n, (name, robot) in enumerate(robots().items()):
        rng = np.random.default_rng([99, n])
        machine = new_machine(robot, rng, tool=0.0)
        day = Day(rng, "normal", 3e-5, exact=True, zero_after=True)
        poses = plan(machine, rng, 15, PATTERNS[0])
        test = test_of(machine, rng)
        seen = measure(out / f"clean-{name}", machine, day, poses, f"clean-{name}", test)
        truth = {
            "stiffness": dict(zip(robot.names, map(float, machine.k), strict=True)),
            "deflection_m": deflection(machine, test),
            "left": visible(machine, seen["displacements"], 3e-5),
        }
        (out / f"clean-{name}" / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


def main():
    """Command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["league", "tables", "clean"])
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=None)
    a = parser.parse_args()
    seed = time.time_ns() if a.seed is None else a.seed
    if a.what == "clean":
        clean(a.out)
    else:
        print(f"seed {seed}")
        {"league": league, "tables": tables}[a.what](a.out, a.count, seed)


if __name__ == "__main__":
    main()
