"""How near straight lines of finite length come to each other, many pairs at once.

Arrays have x, y, z on the first axis and the pairs on the last, where numpy works on long rows.
"""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array

_POINT_M2 = 1e-18
"""Squared length [m^2] from which a segment is one: a shorter one, of a nanometre, is a point."""
_PARALLEL = 1e-14
"""Squared sine of the angle below which rounding says where on parallel segments they are near."""


def closest(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Shares along the segments ab and cd at which they are closest.

    Where both shares are free, s = (uv vw - vv uw) / (uu vv - uv^2) with u = b - a, v = d - c and
    w = a - c; then each is held to its segment and the other one follows (Ericson, Real-Time
    Collision Detection, 2005, 5.1.9).

    Args:
        a: Beginnings of the first segments [m], shape (3, k).
        b: Their ends.
        c: Beginnings of the second ones.
        d: Their ends.

    Returns:
        Share along ab and share along cd, 0 to 1, shape (k,) each.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = dot(u, u), dot(v, v), dot(u, v)
    uw, vw = dot(u, w), dot(v, w)
    skew = uu * vv - uv * uv
    apart = skew > _PARALLEL * uu * vv
    s = np.where(apart, (uv * vw - vv * uw) / np.where(apart, skew, 1.0), 0.0)
    t = _held(np.clip(s, 0, 1) * uv + vw, vv)
    s = _held(t * uv - uw, uu)
    return s, _held(s * uv + vw, vv)


def nearest(a: Array, b: Array, p: Array) -> Array:
    """Share along the segment ab at which it is closest to the point p, all (3, k); shape (k,)."""
    u = b - a
    return _held(dot(u, p - a), dot(u, u))


def length(v: Array) -> Array:
    """Of vectors (3, ...), shape (...)."""
    return np.asarray(np.sqrt(dot(v, v)))


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors (3, ...), shape (...)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _held(part: Array, whole: Array) -> Array:
    """Part / whole, 0 to 1; 0 on a segment that is a point."""
    there = whole > _POINT_M2
    return np.where(there, np.clip(part / np.where(there, whole, 1.0), 0, 1), 0.0)
