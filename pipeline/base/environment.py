"""What libraries take from around a process: the environment and the current folder.

Anybody's campaign may lie in the current folder. Prefect reads `.env`, `prefect.toml` and
`pyproject.toml` there, Matplotlib `matplotlibrc`, and what they say can run programs. So a library
that does so is imported and used in another folder.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

OURS = {
    **{f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")},
    "VECLIB_MAXIMUM_THREADS": "1",
    "PYTHONSAFEPATH": "1",
}
"""What stands in the environment whatever the user has set, before numpy and any other process.

Linear algebra gets one thread: our matrices are small, so that a second one only costs time, and
with the number of threads the last digits change. No module is taken from the current folder, as
`python -c` and `python -m` would, by which multiprocessing and Prefect start processes.
"""


def unproxied() -> dict[str, str]:
    """What keeps a proxy of the environment from being asked for pages of this machine itself."""
    known = os.environ.get("no_proxy") or os.environ.get("NO_PROXY", "")
    return {"no_proxy": ",".join([*filter(None, [known]), "127.0.0.1", "localhost"])}


NOBODYS = "/"
"""A folder in which only those may write to whom the machine belongs; services stand there."""


@contextlib.contextmanager
def elsewhere() -> Iterator[None]:
    """Within the block the current folder is `NOBODYS`; paths have to be absolute there."""
    try:
        here = os.getcwd()
    except FileNotFoundError:  # it was removed: nothing lies in it, and there is no way back
        yield
        return
    os.chdir(NOBODYS)
    try:
        yield
    finally:
        os.chdir(here)
