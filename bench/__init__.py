"""How fast and how good, as ratios measured side by side in one run."""

import os

from pipeline.base.environment import OURS

# before numpy: the last digits of a sum change with the number of threads
os.environ |= {name: value for name, value in OURS.items() if name.endswith("_THREADS")}
