"""The wheel depends on the sources alone: not on when, where and by whom they were checked out."""

import os
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel


class _Alike(bdist_wheel):
    """Without the modes of files, which follow the umask of whoever made the clone."""

    def write_wheelfile(self, *args, **options):
        """Complete the folder that is packed next."""
        super().write_wheelfile(*args, **options)
        for path in Path(self.bdist_dir).rglob("*"):
            path.chmod(0o755 if path.is_dir() else 0o644)


os.environ.setdefault("SOURCE_DATE_EPOCH", "315532800")  # 1980, the first year that a ZIP can hold
setup(cmdclass={"bdist_wheel": _Alike})
