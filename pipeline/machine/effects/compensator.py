"""The gravity compensator stiffens the shoulder by an amount that depends on its angle.

The compliance of the shoulder joint is c + c_cos cos(theta) + c_sin sin(theta): the first harmonic
of a spring or gas strut in parallel with the gear; a second form adds the second harmonic, as of a
strut near its dead centre.
"""

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import arm, compliance, harmonics
from pipeline.machine.robot import Robot

_HARMONICS = {"one harmonic": (1,), "two harmonics": (1, 2)}


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect at the shoulder of a six-axis arm, in two forms."""
    joints = arm(robot)
    if joints is None:
        return ()
    return tuple(_effect(robot, joints[0], form) for form in _HARMONICS)


def _effect(robot: Robot, shoulder: int, form: str) -> Elastic:
    c = compliance(robot, shoulder)
    numbers = _HARMONICS[form]
    names = [f"c_comp_{part}{k if k > 1 else ''}" for k in numbers for part in ("cos", "sin")]

    def response(loaded: Loaded, torque: Array) -> Array:
        return torque * harmonics(loaded.configuration.q[:, shoulder - 1], numbers)

    return Elastic(
        name="compensator",
        noun="gravity compensator",
        place="shoulder",
        form=form,
        tolerance=0.1,
        parameters=tuple(
            Parameter(
                *(name, "rad/(N m)", 0.05 * c),
                meaning="change of the shoulder's compliance with its angle, "
                f"{name.removeprefix('c_comp_')[:3]} part",
            )
            for name in names
        ),
        signature=f"the compliance of joint {shoulder} changes with its angle, not with the load",
        needs=f"one pull repeated at four angles of joint {shoulder}",
        source="equivalent spring beside the gear: Klimchik et al., compensator models "
        "(arXiv 1311.6810); some percent of the joint's compliance",
        carrier=(shoulder,) * len(names),
        response=response,
    )
