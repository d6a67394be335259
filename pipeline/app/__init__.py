"""The command line, in an environment made before any library is there."""

import os

from pipeline.base.environment import OURS, unproxied

os.environ |= OURS | unproxied()
