"""The command line, with environment variables set before any library is imported."""

import os

from pipeline.base.environment import OURS, unproxied

os.environ |= OURS | unproxied()
