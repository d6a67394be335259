"""Certified answers: least squares by definition, solved with 50 digits.

Linear:      x = (B'V^-1 B)^-1 B'V^-1 c, cov(x) = (B'V^-1 B)^-1, with V at x itself if errors of
             the force enter through B x (fixed point).
Unstated:    V = s^2 I with s^2 = r'r / (M - n).
Deformed:    (c - d(x))' (c - d(x)) is minimal; cov(x) = s^2 (J'J)^-1, J = dd/dx at x.
Placing:     sum e_i' C_i^-1 e_i is minimal, e_i = R'(n_i - t) - p_i.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpmath import lu_solve, matrix, mp, mpf

from bench.reference.certify.campaign import Campaign, Key, Pull
from bench.reference.certify.kinematics import (
    Vector,
    add,
    at,
    at_rest,
    cross,
    dot,
    efforts,
    frames,
    less,
    motions,
    times,
    turn_x,
    turn_z,
)

STILL = mpf(10) ** -35


@dataclass
class Certified:
    """Certified values of a campaign.

    Attributes:
        names: Names of the parameters.
        units: Their units.
        value: Estimates.
        std: Their standard uncertainties.
        chi2: Minimised sum of squares: weighted, or [m^2] if no noise is stated.
        dof: Rows minus parameters.
        checks: Further numbers by which a reader can locate differences.
    """

    names: list[str]
    units: list[str]
    value: Vector
    std: Vector
    chi2: Any
    dof: int
    checks: dict[str, Any]


def certify(one: Campaign) -> Certified:
    """Solve a campaign."""
    if one.base:
        return _placing(one)
    names = [f"c_{row.name}" for row in one.robot.rows]
    units = ["m/N" if row.slides else "rad/(N m)" for row in one.robot.rows]
    value, cov, chi2, dof, B, c = _deformed(one) if one.deformed else _linear(one)
    std = [mp.sqrt(cov[k, k]) for k in range(len(value))]
    first = {f"B[1, {k + 1}]": B[0, k] for k in range(len(value))}
    return Certified(names, units, value, std, chi2, dof, {"c[1]": c[0], **first})


def _column(one: Campaign, key: Key, force: Vector) -> Any:
    """B of all targets of a pull under a force: (3 t) x n."""
    chain = frames(one.robot, one.q[key[0]])
    tau = efforts(one.robot, chain, at(chain[-1], one.tool["load_point"]), force)
    out = matrix(3 * len(one.targets), len(one.robot.rows))
    for t, target in enumerate(one.targets):
        moved = motions(one.robot, chain, at(chain[-1], one.tool[target]))
        for j, (direction, effort) in enumerate(zip(moved, tau, strict=True)):
            for i in range(3):
                out[3 * t + i, j] = direction[i] * effort
    return out


def _measured(one: Campaign, keys: list[Key]) -> Any:
    return matrix([v for key in keys for target in one.targets for v in one.moved[key][target]])


def _stacked(blocks: list[Any]) -> Any:
    height = sum(block.rows for block in blocks)
    out, row = matrix(height, blocks[0].cols), 0
    for block in blocks:
        out[row : row + block.rows, :] = block
        row += block.rows
    return out


def _linear(one: Campaign) -> tuple[Vector, Any, Any, int, Any, Any]:
    keys = sorted(one.moved)
    B = _stacked([_column(one, key, one.pulls[key].force) for key in keys])
    c = _measured(one, keys)
    if one.sigma_m is None:
        return _ordinary(B, c)
    if one.sigma_rad is not None:
        return _poses(one, keys, B, c)
    x = _solve(B, c, _readings(one, keys))[0]
    for _ in range(60):
        new, cov, chi2 = _solve(B, c, _readings(one, keys) + _forces(one, keys, x))
        step = max(abs(a / b - 1) for a, b in zip(new, x, strict=True))
        x = new
        if step < STILL:
            return x, cov, chi2, B.rows - B.cols, B, c
    raise ArithmeticError("V and x do not come to rest")


def _ordinary(B: Any, c: Any) -> tuple[Vector, Any, Any, int, Any, Any]:
    N = B.T * B
    x = lu_solve(N, B.T * c)
    r = c - B * x
    chi2, dof = (r.T * r)[0], B.rows - B.cols
    return list(x), N**-1 * (chi2 / dof), chi2, dof, B, c


def _solve(B: Any, c: Any, V: Any) -> tuple[Vector, Any, Any]:
    L = mp.cholesky(V)
    A, y = _forward(L, B), _forward(L, c)
    N = A.T * A
    x = lu_solve(N, A.T * y)
    r = y - A * x
    return list(x), N**-1, (r.T * r)[0]


def _forward(L: Any, right: Any) -> Any:
    """L^-1 right, L lower triangular."""
    out = right.copy()
    for j in range(right.cols):
        for i in range(L.rows):
            known = mp.fsum(L[i, k] * out[k, j] for k in range(i) if L[i, k])
            out[i, j] = (right[i, j] - known) / L[i, i]
    return out


def _readings(one: Campaign, keys: list[Key]) -> Any:
    """Covariance of c due to the readings: loaded ones, and zeros shared by the pulls of a pose."""
    size = 3 * len(one.targets)
    V = matrix(size * len(keys))
    for a, key in enumerate(keys):
        for b, other in enumerate(keys):
            zeros = one.zeros.get(key[0], 0)
            shared = one.sigma_m**2 / zeros if zeros and key[0] == other[0] else 0
            for i in range(size):
                own = one.sigma_m**2 if a == b else 0
                V[size * a + i, size * b + i] = own + shared
    return V


def _forces(one: Campaign, keys: list[Key], x: Vector) -> Any:
    """Covariance of c due to the forces: reading, direction, gain, zero of the scale, weights."""
    size, total = 3 * len(one.targets), 3 * len(one.targets) * len(keys)
    V, common = matrix(total), dict[str, Any]()
    for a, key in enumerate(keys):
        for name, force in _modes(one, one.pulls[key]).items():
            moved = _column(one, key, force) * matrix(x)
            if isinstance(name, str):
                common.setdefault(name, matrix(total, 1))[size * a : size * (a + 1), 0] = moved
            else:
                V[size * a : size * (a + 1), size * a : size * (a + 1)] += moved * moved.T
    for column in common.values():
        V += column * column.T
    return V


def _modes(one: Campaign, pull: Pull) -> dict[Any, Vector]:
    """Independent errors of a force [N]; those common to several pulls have a string as key."""
    size = mp.sqrt(dot(pull.force, pull.force))
    unit = [v / size for v in pull.force]
    if pull.weight is not None:
        return {f"weight {pull.weight}": [pull.mass_n * v for v in unit]}
    other = cross(unit, [1, 0, 0] if abs(unit[0]) < mpf("0.7") else [0, 1, 0])
    length = mp.sqrt(dot(other, other))
    first = [v / length for v in other]
    modes: dict[Any, Vector] = {
        0: [pull.along * v for v in unit],
        1: [size * pull.across * v for v in first],
        2: [size * pull.across * v for v in cross(unit, first)],
        "gain": [one.gain * v for v in pull.force],
        "zero": [one.zero_n * v for v in unit],
    }
    return {name: force for name, force in modes.items() if any(force)}


def _poses(
    one: Campaign, keys: list[Key], B: Any, c: Any
) -> tuple[Vector, Any, Any, int, Any, Any]:
    """Position and rotation instead of targets: mean, and L N^-1 sum l x d."""
    t = len(one.targets)
    middle = [sum(v) / t for v in zip(*(one.tool[n] for n in one.targets), strict=True)]
    arms = [less(one.tool[name], middle) for name in one.targets]
    L = mp.sqrt(sum(dot(arm, arm) for arm in arms) / t)
    maps = []
    for key in keys:
        R = frames(one.robot, one.q[key[0]])[-1][0]
        levers = [times(R, arm) for arm in arms]
        maps.append(_to_pose(levers, L))
    size = 3 * t
    B6 = _stacked([m * B[size * k : size * (k + 1), :] for k, m in enumerate(maps)])
    c6 = _stacked([m * c[size * k : size * (k + 1), 0] for k, m in enumerate(maps)])
    V = matrix(B6.rows)
    for k in range(B6.rows):
        V[k, k] = one.sigma_m**2 if k % 6 < 3 else (L * one.sigma_rad) ** 2
    x, cov, chi2 = _solve(B6, c6, V)
    return x, cov, chi2, B6.rows - B6.cols, B6, c6


def _to_pose(levers: list[Vector], L: Any) -> Any:
    """The 6 x 3 t matrix of s and L w."""
    t = len(levers)
    N = matrix(3)
    for lever in levers:
        for i in range(3):
            for j in range(3):
                N[i, j] += (dot(lever, lever) if i == j else 0) - lever[i] * lever[j]
    inverse, out = N**-1, matrix(6, 3 * t)
    for k, lever in enumerate(levers):
        a, b, z = lever
        skew = matrix([[0, -z, b], [z, 0, -a], [-b, a, 0]])
        turned = inverse * skew * L
        for i in range(3):
            out[i, 3 * k + i] = mpf(1) / t
            for j in range(3):
                out[3 + i, 3 * k + j] = turned[i, j]
    return out


def _deformed(one: Campaign) -> tuple[Vector, Any, Any, int, Any, Any]:
    keys = sorted(one.moved)
    c = _measured(one, keys)
    B = _stacked([_column(one, key, one.pulls[key].force) for key in keys])
    x = _ordinary(B, c)[0]
    for _ in range(80):
        J = _derivative(lambda values: _moved(one, keys, values), x)
        r = c - _moved(one, keys, x)
        step = lu_solve(J.T * J, J.T * r)
        x = [a + b for a, b in zip(x, step, strict=True)]
        if max(abs(s / v) for s, v in zip(step, x, strict=True)) < mpf(10) ** -20:
            break
    else:
        raise ArithmeticError("Gauss and Newton do not come to rest")
    r = c - _moved(one, keys, x)
    chi2, dof = (r.T * r)[0], J.rows - J.cols
    return x, (J.T * J) ** -1 * (chi2 / dof), chi2, dof, J, c


def _moved(one: Campaign, keys: list[Key], x: Vector) -> Any:
    out = []
    for key in keys:
        q = one.q[key[0]]
        rest = frames(one.robot, q)[-1]
        bent = at_rest(one.robot, q, x, one.tool["load_point"], one.pulls[key].force)[-1]
        for target in one.targets:
            out += less(at(bent, one.tool[target]), at(rest, one.tool[target]))
    return matrix(out)


def _derivative(of: Callable[[Vector], Any], x: Vector) -> Any:
    """Central differences; their error is 1e-24 of the derivative."""
    columns = []
    for k, value in enumerate(x):
        h = abs(value) * mpf(10) ** -12
        ahead = of([v + (h if k == i else 0) for i, v in enumerate(x)])
        behind = of([v - (h if k == i else 0) for i, v in enumerate(x)])
        columns.append((ahead - behind) / (2 * h))
    out = matrix(columns[0].rows, len(columns))
    for k, column in enumerate(columns):
        out[:, k] = column
    return out


def _placing(one: Campaign) -> Certified:
    """Pose of the tracker: its frame in F_b from readings of the base reflectors."""
    noise = one.said["tracker"]["noise"]
    shots = [(name, p) for _, name, p in one.readings if name in one.base]
    read = [(one.base[name], p, _weight(p, noise)) for name, p in shots]
    R, t = _rough(read)
    for _ in range(60):
        N, g, chi2 = matrix(6), matrix(6, 1), mpf(0)
        for place, point, W in read:
            away = less(place, t)
            e = matrix(less(times(R.T, away), point))
            D = _by_motion(R, away)
            N += D.T * W * D
            g -= D.T * W * e
            chi2 += (e.T * W * e)[0]
        step = lu_solve(N, g)
        R, t = _turned(list(step[:3])) * R, add(t, list(step[3:]))
        if max(abs(v) for v in step) < mpf(10) ** -30:
            break
    else:
        raise ArithmeticError("Gauss and Newton do not come to rest")
    cov = N**-1
    names = [f"R[{i}, {j}]" for i in (1, 2, 3) for j in (1, 2, 3)] + ["t_x", "t_y", "t_z"]
    std = [mp.sqrt(cov[k, k]) for k in range(6)]
    turns = {f"u(rotation about {a})": u for a, u in zip("xyz", std[:3], strict=True)}
    value = [R[i, j] for i in range(3) for j in range(3)] + t
    none = [mpf("nan")] * 9
    units = ["1"] * 9 + ["m"] * 3
    return Certified(names, units, value, none + std[3:], chi2, 3 * len(read) - 6, turns)


def _weight(p: Vector, noise: dict[str, Any]) -> Any:
    """Inverse covariance of a reading: uncertainties along and across the beam grow with range."""
    far = mp.sqrt(dot(p, p))
    along = noise["range_m"] + noise["range_per_m"] * far
    across = noise["transverse_m"] + noise["transverse_per_m"] * far
    W = matrix(3)
    for i in range(3):
        for j in range(3):
            beam = p[i] * p[j] / far**2
            W[i, j] = beam / along**2 + ((1 if i == j else 0) - beam) / across**2
    return W


def _rough(read: list[tuple[Vector, Vector, Any]]) -> tuple[Any, Vector]:
    """Initial frame from three reflectors: axes of their triangle in both frames."""
    (a, p, _), (b, q, _), (c, r, _) = read[:3]
    here, there = _triangle(a, b, c), _triangle(p, q, r)
    R = here * there.T
    return R, less(a, times(R, p))


def _triangle(a: Vector, b: Vector, c: Vector) -> Any:
    x = less(b, a)
    x = [v / mp.sqrt(dot(x, x)) for v in x]
    z = cross(x, less(c, a))
    z = [v / mp.sqrt(dot(z, z)) for v in z]
    return matrix([x, cross(z, x), z]).T


def _by_motion(R: Any, away: Vector) -> Any:
    """Derivative of R'(n - t) by a rotation of R in F_b and a translation of t, 3 x 6."""
    out = matrix(3, 6)
    for axis in range(3):
        unit = [mpf(int(axis == i)) for i in range(3)]
        turned, shifted = times(R.T, cross(away, unit)), times(R.T, unit)
        for i in range(3):
            out[i, axis], out[i, 3 + axis] = turned[i], -shifted[i]
    return out


def _turned(w: Vector) -> Any:
    """A rotation by a small vector, to first order and exactly orthogonal."""
    return turn_z(w[2]) * _about_y(w[1]) * turn_x(w[0])


def _about_y(angle: Any) -> Any:
    c, s = mp.cos(angle), mp.sin(angle)
    return matrix([[c, 0, s], [0, 1, 0], [-s, 0, c]])
