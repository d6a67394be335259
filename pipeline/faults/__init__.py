"""Mistakes in the data: found, named and corrected; one file per fault, one line each below.

Each is a discrete mistake with a discrete correction. A mistake is reported only when the data
support it and its correction makes them agree; both results are given, corrected and as given.
"""

from pipeline.faults import (
    anchor,
    base_names,
    base_reading,
    base_reflector,
    base_rounds,
    chain,
    conventions,
    covariance_stated,
    dead_sensor,
    exchanged,
    exchanged_ladders,
    exchanged_pulls,
    gross_reading,
    joint_row,
    labels,
    loose_target,
    named_twice,
    placement,
    pose_moved,
    pull,
    reading,
    scale_reading,
    scale_rows,
    stale_reading,
    tool_point,
    unit_since,
)
from pipeline.faults.fault import Fault

FAULTS: tuple[Fault, ...] = (
    stale_reading.FAULT,
    named_twice.FAULT,
    unit_since.FAULT,
    scale_rows.FAULT,
    base_names.FAULT,
    base_rounds.FAULT,
    base_rounds.CARRIED,
    exchanged.FAULT,
    labels.CHAIN,
    dead_sensor.FAULT,
    anchor.PLACE,
    anchor.FAULT,
    exchanged_pulls.FAULT,
    exchanged_ladders.FAULT,
    joint_row.FAULT,
    conventions.FAULT,
    placement.FAULT,
    labels.FAULT,
    tool_point.FAULT,
    gross_reading.FAULT,
    covariance_stated.FAULT,
    base_reading.ONE_READING,
    base_reflector.FAULT,
    base_reading.SEVERAL_READINGS,
    loose_target.FAULT,
    pose_moved.FAULT,
    chain.GROSS_FAULT,
    chain.FAULT,
    reading.FAULT,
    scale_reading.FAULT,
    pose_moved.LAST,
    pull.REVERSED,
    pull.UNIT,
)
"""Faults in the order of their tests: first those of whole files; then those of single readings,
base and chain before the robot; last those that scale or rotate all forces alike, which no residual
shows and a bad reading may imitate."""
