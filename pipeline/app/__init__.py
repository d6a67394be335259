"""The command line, with environment variables set before any library is imported."""

import os

from pipeline.base.environment import OWN_VARIABLES, unproxied

os.environ |= OWN_VARIABLES | unproxied()
