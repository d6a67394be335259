"""By itself through Prefect: on this machine alone, or on a team's own server."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

from pipeline.app import server
from pipeline.app.preferences import Preferences
from pipeline.base.errors import UsageError


def serve(root: Path, preferences: Preferences, started: Callable[[dict[str, str]], None]) -> None:
    """Start Prefect's server and the reports' on this machine, and scan data/raw until stopped.

    Args:
        root: The project's root.
        preferences: How often to scan, and where Prefect's page is.
        started: Called with the addresses when all is up.

    Raises:
        UsageError: The port is taken, or Prefect's server does not start.
        KeyboardInterrupt: It was stopped by Ctrl-C.
    """
    port = preferences.service.port
    already = server.serving(root)
    if already is not None:
        raise UsageError(f"{root.resolve()} is served already: see {already['page']}")
    page = f"http://{server.HERE}:{port}"
    urls = {"page": page, "api": f"{page}/api", "reports": f"http://{server.HERE}:{port + 1}"}
    server.free(port)
    server.free(port + 1)
    os.environ["PREFECT_API_URL"] = urls["api"]
    os.environ[server.REPORTS_URL] = urls["reports"]
    os.environ[server.PARENT] = str(os.getpid())
    server.settle(root)
    with (
        server.sheltered(signal.SIGTERM),  # which Prefect's runner takes for a wish to stop
        server.running(root, port),
        server.reports(root, port + 1),
        server.recorded(root, urls),
    ):
        from pipeline.app.flow import serve as serve_flow

        started(urls)
        serve_flow(root.resolve(), preferences)
    raise KeyboardInterrupt  # Prefect's runner swallows it and comes back


def deploy(root: Path, pool: str, preferences: Preferences) -> str:
    """Put the scan of data/raw on the Prefect server of PREFECT_API_URL; how to start a worker.

    Raises:
        UsageError: PREFECT_API_URL is not set, or nobody answers there.
    """
    api = os.environ.get("PREFECT_API_URL", "").rstrip("/")
    if not api:
        raise UsageError(
            "PREFECT_API_URL is not set: give the address of your Prefect server, "
            "such as http://prefect.example:4200/api"
        )
    if not server.answers(api):
        raise UsageError(
            f"no Prefect server answers at {api}: start it, or correct PREFECT_API_URL"
        )
    server.settle(root)
    from pipeline.app.flow import deploy as deploy_flow

    deploy_flow(root.resolve(), pool, preferences)
    return f"prefect worker start --pool {pool}"
