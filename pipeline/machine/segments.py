"""Closest points of line segments, vectorised over many pairs.

Arrays have x, y, z on the first axis and the pairs on the last, so that numpy works on long rows.
"""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Array

_POINT_M2 = 1e-18
"""Squared length [m^2] up to which a segment, shorter than a nanometre, is treated as a point."""
_PARALLEL = 1e-14
"""Squared sine of the angle [1] below which segments count as parallel, as rounding would
dominate."""


def closest(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Positions along the segments ab and cd at which they are closest, as fractions.

    For unconstrained fractions s = (uv vw - vv uw) / (uu vv - uv^2) with u = b - a, v = d - c and
    w = a - c; then each is clamped to its segment and the other one follows (Ericson, Real-Time
    Collision Detection, 2005, 5.1.9).

    Args:
        a: Start points of the first segments [m], shape (3, k).
        b: Their end points.
        c: Start points of the second segments.
        d: Their end points.

    Returns:
        Fraction along ab and fraction along cd, 0 to 1, shape (k,) each.
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
    """Fraction along the segment ab closest to the point p, all (3, k); shape (k,)."""
    u = b - a
    return _held(dot(u, p - a), dot(u, u))


def length(v: Array) -> Array:
    """Norms of vectors (3, ...), shape (...)."""
    return np.asarray(np.sqrt(dot(v, v)))


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors (3, ...), shape (...)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _held(part: Array, whole: Array) -> Array:
    """Part / whole, clamped to 0 to 1; 0 for a segment that is a point."""
    there = whole > _POINT_M2
    return np.where(there, np.clip(part / np.where(there, whole, 1.0), 0, 1), 0.0)
