"""Outbuilding: campaigns processed automatically, on this machine, for a team or on a cluster.

Door: `service.command` for the command line; for `pipeline run` `service.engine` (Prefect),
`service.cluster` (Dask) and `service.sync` (object storage).
Tests: `tests/service/`.
"""

import os

from pipeline.base.environment import OWN_VARIABLES

os.environ |= OWN_VARIABLES
