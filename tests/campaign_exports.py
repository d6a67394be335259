"""One campaign as many programs would write it, independent of our readers.

Three reflectors on a flange in ten poses, unloaded and loaded, and four base points before and
after, at 2 to 12 m.
"""

from __future__ import annotations

import io
import math
import zipfile

import numpy as np

PER_METRE = {"mm": 1e3, "m": 1.0, "in": 1 / 0.0254, "um": 1e6, "cm": 1e2, "ft": 1 / 0.3048}
_TOOL = np.array([[0.20, 0.05, 0.12], [-0.12, 0.19, 0.10], [-0.10, -0.18, 0.22]])
_BASE = {
    "B1": (2.1, -1.4, -1.1), "B2": (9.6, 6.3, -1.12),
    "B3": (4.2, 9.5, -0.9), "B4": (-2.5, 7.7, -1.05),
}  # fmt: skip


def _turn(vector):
    """Rotation by a rotation vector, Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def campaign(seed=5):
    """Group, target and position [m] of every reading."""
    rng = np.random.default_rng(seed)

    def base(group):
        return [(group, name, np.array(at) + rng.normal(0, 3e-5, 3)) for name, at in _BASE.items()]

    points = base("base_start")
    for pose in range(1, 11):
        R, at = _turn(rng.normal(0, 1, 3)), rng.uniform((2, -3, -0.6), (9, 8, 1.6))
        bent, moved = _turn(rng.normal(0, 3e-4, 3)), rng.normal(0, 4e-4, 3)
        for state, tool, shift in (
            ("rep0_unloaded", _TOOL @ R.T, 0.0),
            ("rep1_loaded", _TOOL @ R.T @ bent.T, moved),
        ):
            points += [
                (f"pose{pose:02d}_{state}", f"P{k}", p + at + shift) for k, p in enumerate(tool, 1)
            ]
    return points + base("base_end")


POINTS = campaign()


def table(separator, head, row, above=(), end="\n"):
    """Lines above, titles, and `row` applied to number, group, target and position of a reading."""
    rows = [separator.join(row(k, *point)) for k, point in enumerate(POINTS)]
    return "".join(line + end for line in [*above, *([head] if head else []), *rows])


def xyz(place, unit="mm", digits=4):
    """Coordinates as text."""
    return [f"{value * PER_METRE[unit]:.{digits}f}" for value in place]


def german(cells, thousands="."):
    """Numbers written with a decimal comma."""
    grouped = (f"{float(cell):,.4f}" for cell in cells)
    return [cell.replace(",", "~").replace(".", ",").replace("~", thousands) for cell in grouped]


def polar(place):
    """Distance [m], horizontal angle in the sense of a total station, and zenith angle [deg]."""
    far = float(np.linalg.norm(place))
    x, y, z = place
    return far, math.degrees(math.atan2(-y, x)) % 360, math.degrees(math.acos(z / far))


def dms(angle, form="{}°{:02d}'{:07.4f}\""):
    """Degrees as degrees, minutes and seconds."""
    minutes, seconds = divmod(round(abs(angle) * 36e6), 60 * 10**4)
    return "-" * (angle < 0) + form.format(minutes // 60, minutes % 60, seconds / 1e4)


def workbook(sheets):
    """A small .xlsx: rows of texts and numbers by sheet name."""
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    names = [f"xl/worksheets/sheet{k}.xml" for k in range(1, len(sheets) + 1)]
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types">'
        '<Default Extension="rels" ContentType='
        '"application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="xml" ContentType="application/xml"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets>'
        + "".join(
            f'<sheet name="{name}" sheetId="{k}" r:id="r{k}"/>' for k, name in enumerate(sheets, 1)
        )
        + "</sheets></workbook>",
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships">'
        + "".join(
            f'<Relationship Id="r{k}" Type="{office}/worksheet" Target="worksheets/sheet{k}.xml"/>'
            for k in range(1, len(sheets) + 1)
        )
        + "</Relationships>",
        **{
            name: f'<worksheet xmlns="{main}"><sheetData>'
            + "".join(f"<row>{''.join(map(_cell, row))}</row>" for row in rows)
            + "</sheetData></worksheet>"
            for name, rows in zip(names, sheets.values(), strict=True)
        },
    }
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as packed:
        for name, part in parts.items():
            packed.writestr(name, part)
    return out.getvalue()


def _cell(value):
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
    return f"<c><v>{float(value)!r}</v></c>"
