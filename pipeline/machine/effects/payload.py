"""A payload deviates from campaign.toml: its mass is m (1 + g), its centre at c + d.

The mass can be estimated only if something else loads the robot, too: with one payload alone it
scales all stiffnesses by the same percentage.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from pipeline.base.arrays import Array, Bools, Parameter, vector
from pipeline.machine.effect import MOUNTED, Effect, Loaded, Pulls, Wrench

NOUNS = {"payload_mass": "wrong mass", "payload_center": "wrong centre of mass"}
"""Noun of each effect; the name of the payload follows it."""


def effects(pulls: Pulls) -> tuple[Effect, ...]:
    """Mass and centre effects of each payload of a campaign.

    The mass is left out if one payload is the only load.
    """
    mounted = pulls.by == MOUNTED
    names = sorted({*pulls.body[mounted].tolist()})
    told = len(names) > 1 or not mounted.all()
    return (*[_mass(name) for name in names if told], *(_centre(name) for name in names))


def _mass(name: str) -> Effect:
    return Wrench(
        name="payload_mass",
        where=name,
        noun=NOUNS["payload_mass"],
        place="force",
        parameters=(Parameter("g_mass", "1", 0.01, -1.0, meaning="correction of the stated mass"),),
        signature="all that one payload moves is off by the same percentage; another one disagrees",
        needs="the payload on a scale, or the joint torques",
        source="f = m g; 1 % is an estimate",
        wrench=partial(_heavier, name),
        of=(MOUNTED,),
    )


def _centre(name: str) -> Effect:
    return Wrench(
        name="payload_center",
        where=name,
        noun=NOUNS["payload_center"],
        place="force",
        parameters=vector(
            *("dc_{}", "m", 5e-3, -0.5, 0.5),
            meaning="correction of the stated centre of mass along {}",
        ),
        signature="torques of the wrist are off by the payload's weight times a lever fixed in it",
        needs="the centre weighed or from the drawing, or the joint torques",
        source="moment d x m g; 5 mm is an estimate",
        wrench=partial(_elsewhere, name),
        of=(MOUNTED,),
    )


def _heavier(name: str, loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """Stated centre, with the force of the true mass."""
    return loaded.load_point, loaded.force * (1 + _here(name, loaded)[:, None] * values[0])


def _elsewhere(name: str, loaded: Loaded, values: Array) -> tuple[Array, Array]:
    """True centre, with the stated force."""
    shift = loaded.configuration.flange_axes @ values
    return loaded.load_point + _here(name, loaded)[:, None] * shift, loaded.force


def _here(name: str, loaded: Loaded) -> Bools:
    return np.asarray(loaded.pulls.body == name, dtype=bool)
