"""Benchmarks of speed and quality, mostly as ratios measured side by side in one run."""

import os

from pipeline.base.environment import OWN_VARIABLES

# before numpy is imported: the last digits of a sum depend on the number of threads
os.environ |= {name: value for name, value in OWN_VARIABLES.items() if name.endswith("_THREADS")}
