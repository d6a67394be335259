"""The systemd unit that runs `pipeline serve` for this project and the current user."""

from __future__ import annotations

import getpass
import sys
from importlib import resources
from pathlib import Path

import jinja2

from pipeline.base.errors import UsageError


def unit(root: Path) -> str:
    """Text of the unit file.

    Raises:
        UsageError: The path of the project or of Python is not allowed in a unit file.
    """
    paths = {"root": str(root.resolve()), "python": sys.executable}
    for path in paths.values():
        if any(sign in path for sign in " \t\n\"'\\%$"):
            raise UsageError(f"systemd cannot run what lies in {path}: move it to a plain path")
    template = (resources.files(__package__) / "pipeline.service.jinja").read_text("utf-8")
    return jinja2.Template(template).render(user=getpass.getuser(), **paths)
