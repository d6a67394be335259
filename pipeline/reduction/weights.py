"""Forces exerted by weights at the load point and by payloads on the flange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.machine.effect import HUNG, MOUNTED, PULLED
from pipeline.reduction.settings import PayloadSettings, Settings

PULL = -1
"""Body number of a pull by a chain, which has no body."""

_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Weights(Locked):
    """Weight or payload in each row of the loads.

    Attributes:
        by: `PULLED`, `HUNG` or `MOUNTED`, shape (m,).
        body: Number of the weight or payload, `PULL` where a chain pulls, shape (m,).
        mass: [kg], NaN where a chain pulls, shape (m,).
        mass_std: Its standard uncertainty, one error for each body [kg], shape (m,).
        center: Point of action, flange frame [m]; NaN at the load point, shape (m, 3).
        center_std: Its standard uncertainty per axis, one error for each body [m], shape (m,).
    """

    by: Ints
    body: Ints
    mass: Array
    mass_std: Array
    center: Array
    center_std: Array

    @classmethod
    def of(cls, payloads: Mapping[str, PayloadSettings], loads: pd.DataFrame) -> Weights:
        """From rows of table LOADS; weights of equal mass and uncertainty count as one body."""
        names = list(payloads)
        loads = loads.reindex(columns=["payload", "mass_kg", "mass_sigma_kg"])
        named = loads["payload"].astype(object)
        mounted = pd.Index(names).get_indexer(pd.Index(named.where(named.notna(), "")))
        mounted = np.where(named.notna(), mounted, -1)
        hung, on = loads["mass_kg"].notna().to_numpy(), mounted >= 0
        own = loads[["mass_kg", "mass_sigma_kg"]].to_numpy(float)
        which = np.unique(np.nan_to_num(own), axis=0, return_inverse=True)[1].ravel()
        selected = [(p.mass_kg, p.mass_sigma_kg, p.center_sigma_m) for p in payloads.values()]
        table = np.array([*selected, (np.nan, 0.0, 0.0)])[mounted]
        centers = np.array([*(p.center_m for p in payloads.values()), (np.nan,) * 3])
        return cls(
            by=np.where(on, MOUNTED, np.where(hung, HUNG, PULLED)),
            body=np.where(on, mounted, np.where(hung, len(names) + which, PULL)),
            mass=np.where(hung, own[:, 0], table[:, 0]),
            mass_std=np.where(hung, own[:, 1], table[:, 1]),
            center=centers[mounted],
            center_std=table[:, 2],
        )

    def only(self, rows: Bools) -> Weights:
        """The selected rows."""
        return Weights(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})

    def force(self, gravity: Array) -> Array:
        """Force m g of each body in F_b [N], shape (m, 3); NaN where a chain pulls."""
        return self.mass[:, None] * gravity

    def columns(self, settings: Settings) -> dict[str, Array | Ints]:
        """Columns of table FORCES that describe the body and its uncertainties."""
        size = float(np.linalg.norm(settings.gravity.vector))
        at = {f"at_{axis}_m": self.center[:, k] for k, axis in enumerate(_AXES)}
        std = {"mass_std_n": size * self.mass_std, "center_std_m": self.center_std}
        return {"by": self.by, "body": self.body, **at, **std}
