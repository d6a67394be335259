"""Outbuilding: campaigns that run by themselves, on this machine, a team's or a cluster.

Door: `service.command` for the command line; for `pipeline run` `service.engine` (Prefect),
`service.cluster` (Dask) and `service.sync` (object storage).
Tests: test_serve.py, test_service.py, test_watch.py, test_guard.py, test_gate.py, test_flow.py,
test_teams.py, test_cluster.py, test_storage.py, test_doctor.py.
"""

import os

from pipeline.base.environment import OURS

os.environ |= OURS
