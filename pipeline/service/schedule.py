"""`python -m pipeline.service.schedule SERVICE`: scan at the scheduled times until told to stop."""

from __future__ import annotations

import os
import sys

from pipeline.library.preferences import Service
from pipeline.service.processes import PARENT, follow


def main(wanted: str) -> None:
    """Serve the scan through Prefect, whose settings are in the environment.

    Args:
        wanted: preferences.Service, as JSON.
    """
    follow(int(os.environ[PARENT]))
    from pipeline.service import flow

    flow.serve(Service.model_validate_json(wanted))


if __name__ == "__main__":
    main(*sys.argv[1:])
