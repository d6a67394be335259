"""An arm as a URDF with masses, for tools that read one."""

import numpy as np

from bench.peers.arm import Arm


def urdf(arm: Arm) -> str:
    """The arm as a URDF with masses; a joint's origin is Rx(alpha) Tx(a) Tz(d).

    Raises:
        ValueError: A joint slides or has an offset of theta, which an origin would have to rotate.
    """
    if arm.table[:, 2].any() or arm.slides.any():
        raise ValueError("only turning joints without an offset")
    links, parent = ['<link name="base"/>'], "base"
    for name, row, (alpha, a, _, d) in zip(arm.axes, arm.rows, arm.table, strict=True):
        link = name.replace("_joint", "_link")
        at = " ".join(repr(float(v)) for v in (a, -np.sin(alpha) * d, np.cos(alpha) * d))
        ends = np.deg2rad([row["lower_deg"], row["upper_deg"]])
        mass = " ".join(str(v) for v in row["centre_of_mass_m"])
        links.append(
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{at}" rpy="{float(alpha)!r} 0 0"/>'
            f'<axis xyz="0 0 1"/><limit lower="{ends[0]:.9f}" upper="{ends[1]:.9f}" '
            f'effort="{row["effort_nm"]}" velocity="3"/></joint>'
            f'<link name="{link}"><inertial><origin xyz="{mass}"/><mass value="{row["mass_kg"]}"/>'
            '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        parent = link
    return f'<robot name="{arm.name}">' + "\n".join(links) + "</robot>\n"
