"""Settings of campaign.toml for exports and logs that do not describe themselves."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

from pipeline.base.strict import Name, Positive, Strict, with_parts

_Unit = Literal["mm", "m", "in", "um", "cm", "ft", "ftUS"]
_Role = Literal[
    "group", "pose", "state", "repeat", "target", "date", "time", "delete", "active", "instrument",
    "x", "y", "z", "range", "azimuth", "vertical",
    "sx", "sy", "sz", "u95_x", "u95_y", "u95_z", "cxx", "cxy", "cxz", "cyy", "cyz", "czz",
]  # fmt: skip
ROLES: tuple[str, ...] = get_args(_Role)
"""What a column of [tracker.mapping] may be."""

GroupNames = Literal["files", "folders/files", "files::groups"]
"""What names groups besides or instead of the export."""

_Column = Annotated[int, Field(ge=1)] | Annotated[str, Field(min_length=1)]


class Columns(Strict):
    """[tracker.mapping]: columns of any delimited table, by header name or by number from 1.

    Attributes:
        columns: Name or number of the column by role; sx, sy, sz are uncertainties, cxx ... czz
            covariances; pose, state and repeat in columns of their own form the group, in this
            order.
        delimiter: One character, or None to determine it.
        header: Line of the header, 0 for none, or None to determine it.
        first: Line of the first row, if not the one after the header.
        last: Line of the last row, None for the last one of the file.
        comment: Start of comment lines.
        time_format: A `strptime` format, or None for the known formats.
        instrument: Which instrument in the column of that name to read, None for all.
    """

    columns: dict[_Role, _Column] = Field(min_length=3)
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    header: Annotated[int, Field(ge=0)] | None = None
    first: Annotated[int, Field(ge=1)] | None = None
    last: Annotated[int, Field(ge=1)] | None = None
    comment: Annotated[str, Field(min_length=1)] | None = None
    time_format: str | None = None
    instrument: str | None = None


class ExportSettings(Strict):
    """Settings in [tracker] of campaign.toml for exports that do not describe themselves.

    Attributes:
        unit: Unit of length.
        decimal: The decimal mark.
        coordinates: Kind of coordinates.
        angle: Unit of angles.
        vertical: Direction in which vertical angles are zero.
        horizontal: Sense in which horizontal angles increase, seen from above.
        covariance: Which of several covariances to use, or `none`.
        coverage_factor: k of stated uncertainties.
        names: Regular expression with the parts group and target, for names that hold both.
        groups: What names groups besides the export: `files` the name of a file with targets
            only, `folders/files` with that of its folder, `files::groups` the file and the group
            in it.
        mapping: Columns of a table in no known dialect.
        sheet: Sheet of a workbook, if several fit.
    """

    unit: _Unit | None = None
    decimal: Literal[".", ","] | None = None
    coordinates: Literal["cartesian", "spherical", "cylindrical"] | None = None
    angle: Literal["deg", "rad", "gon", "dms"] | None = None
    vertical: Literal["zenith", "elevation"] | None = None
    horizontal: Literal["clockwise", "counter-clockwise"] | None = None
    covariance: Literal["a-priori", "standard", "expanded", "rms", "none"] | None = None
    coverage_factor: Positive | None = None
    names: Annotated[str, with_parts("group", "target")] | None = None
    groups: GroupNames | None = None
    mapping: Columns | None = None
    sheet: Name | None = None


class LogForm(Strict):
    """Format of a log written by other programs.

    Attributes:
        columns: Our name of a column, with its unit, by its title in the file.
        decimal: The decimal mark, if the numbers leave it ambiguous.
        sheet: Sheet of a workbook, if several fit.
    """

    columns: dict[Name, Name] = Field(default_factory=dict)
    decimal: Literal[".", ","] | None = None
    sheet: Name | None = None


_Pulses = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]


class JointForm(LogForm):
    """Format of a joint log written by other programs.

    Attributes:
        pulses: Encoder pulses per degree (a sliding axis: per mm) by our name of the axis; or these
            and the pulses at which it shows 0.
    """

    pulses: dict[Name, _Pulses | tuple[_Pulses, _Pulses]] = Field(default_factory=dict)


OWN_LOG = LogForm()
"""Format of our own logs."""
