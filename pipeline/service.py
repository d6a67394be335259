"""What Prefect needs around it; nothing here imports Prefect, so that it can come before."""

from __future__ import annotations

import os
from pathlib import Path

HOME = ".prefect"
"""Prefect's own files, under the project's root."""


def settle(root: Path) -> None:
    """Settings that must stand in the environment before Prefect is imported.

    What the user has set already stays: with PREFECT_API_URL the flow runs on that server. Logs go
    to Prefect's page in full; on the screen they would bury the one sentence that matters.
    """
    os.environ.setdefault("PREFECT_HOME", str(root.resolve() / HOME))
    os.environ.setdefault("DO_NOT_TRACK", "1")
    os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
    os.environ.setdefault("PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS", "120")
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
