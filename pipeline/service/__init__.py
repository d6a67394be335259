"""Outbuilding: campaigns that run by themselves, on this machine, a team's or a cluster.

Door: `service.command` for the command line; for `pipeline run` `service.engine` (Prefect),
`service.cluster` (Dask) and `service.sync` (object storage).
Tests: `tests/service/`.
"""

import os

from pipeline.base.environment import OURS

os.environ |= OURS
