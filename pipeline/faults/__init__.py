"""Bad data found and named: one file per fault, one line each below.

Each is a discrete mistake with a discrete correction. A mistake is stated only when the data speak
for it and its correction makes them agree; both results are given, corrected and as given.
"""

from pipeline.faults import (
    base_reading,
    base_reflector,
    chain,
    conventions,
    joint_row,
    labels,
    pull,
    reading,
    scale_reading,
)
from pipeline.faults.fault import Fault

FAULTS: tuple[Fault, ...] = (
    joint_row.FAULT,
    conventions.FAULT,
    labels.FAULT,
    scale_reading.FAULT,
    pull.REVERSED,
    pull.UNIT,
    chain.FAULT,
    base_reading.FAULT,
    base_reflector.FAULT,
    reading.FAULT,
)
"""In the order of the tests: the grossest mistakes first, and of single readings the cheapest."""
