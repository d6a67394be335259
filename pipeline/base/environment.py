"""Influences of the environment and the current folder on libraries.

The current folder may contain anybody's campaign. Prefect reads `.env`, `prefect.toml` and
`pyproject.toml` there, Matplotlib `matplotlibrc`, and their content can start programs. Libraries
that do so are therefore imported and used in another folder.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

OWN_VARIABLES = {
    **{f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")},
    "VECLIB_MAXIMUM_THREADS": "1",
    "PYTHONSAFEPATH": "1",
}
"""Environment variables that are set regardless of the user's values, before numpy and other
processes start. Linear algebra gets one thread: our matrices are small, so that a second one only
costs time, and the last digits change with the number of threads. No module is taken from the
current folder, as `python -c` and `python -m`, by which multiprocessing and Prefect start
processes, would do."""


def unproxied() -> dict[str, str]:
    """Environment variable that keeps requests to this machine from going through a proxy."""
    known = os.environ.get("no_proxy") or os.environ.get("NO_PROXY", "")
    return {"no_proxy": ",".join([*filter(None, [known]), "127.0.0.1", "localhost"])}


@contextlib.contextmanager
def without(name: str) -> Iterator[str | None]:
    """Remove an environment variable within the block, and return its value."""
    value = os.environ.pop(name, None)
    try:
        yield value
    finally:
        if value is not None:
            os.environ[name] = value


NOBODYS = "/"
"""A folder in which only administrators can write; working directory of services."""


@contextlib.contextmanager
def elsewhere() -> Iterator[None]:
    """Change the current folder to `NOBODYS` within the block; paths must be absolute there."""
    try:
        here = os.getcwd()
    except FileNotFoundError:  # it was removed: harmless, and there is no way back
        yield
        return
    os.chdir(NOBODYS)
    try:
        yield
    finally:
        os.chdir(here)
