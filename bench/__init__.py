"""How fast and how good, as ratios measured side by side in one run."""

import os

from pipeline.base.environment import OURS

os.environ |= OURS  # before numpy: the last digits of a sum change with the number of threads
