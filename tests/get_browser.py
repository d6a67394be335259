"""Find a browser for test_browser.py; run as a program, try to install one first.

`make test` runs it. It never fails: without a browser the tests of the page are skipped.
"""

from __future__ import annotations

import os
import shutil
import subprocess

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE_S = 420


def browser_path() -> str | None:
    """Path of a Chromium: BROWSER_PATH, or one that is on the PATH."""
    return os.environ.get("BROWSER_PATH") or next(filter(None, map(shutil.which, NAMES)), None)


def install() -> None:
    """Install one with the system's package manager, if that needs no password."""
    if not shutil.which("apt-get") or not hasattr(os, "geteuid") or os.geteuid() != 0:
        return
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "timeout": PATIENCE_S}
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    for words in (["update"], ["install", "-y", "--no-install-recommends", "chromium"]):
        try:
            subprocess.run(["apt-get", "-qq", *words], env=environment, check=False, **quiet)
        except (OSError, subprocess.TimeoutExpired):
            return


if __name__ == "__main__" and browser_path() is None:
    install()
