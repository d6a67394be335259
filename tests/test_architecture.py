"""The walls of the house, read from the code's own imports."""

import ast
import functools
import graphlib
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.xdist_group("architecture")  # every file is parsed once

PACKAGE = Path(__file__).parents[1] / "pipeline"
CORE = (
    "machine",
    "programs",
    "readers",
    "reduction",
    "system",
    "faults",
    "diagnosis",
    "prediction",
    "design",
    "simulate",
    "geometry",
    "wear",
)
OUTSIDE = {"prefect", "typer", "matplotlib", "filelock", "jinja2", "typst"}
LATE = ("pinocchio", "prefect", "matplotlib", "scipy", "pandas", "pyarrow", "numpy")


@functools.cache
def nodes(path):
    """Everything that is written in a file."""
    return tuple(ast.walk(ast.parse(path.read_text("utf-8"))))


def imports(path):
    """Every module that a file imports, also inside functions."""
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module


FILES = sorted(p for part in CORE for p in (PACKAGE / part).rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(PACKAGE).as_posix())
def test_the_core_knows_no_shell(path):
    """Physics, statistics and their like import nothing that runs, draws or prints."""
    assert OUTSIDE.isdisjoint(name.split(".")[0] for name in imports(path))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(PACKAGE).as_posix())
def test_the_core_does_not_open_files(path):
    """Bytes come in and go out as values; only robot and model files are found by path."""
    names = {
        node.func.id
        for node in nodes(path)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }

    assert "open" not in names
    assert "print" not in names
    if path.name not in ("mdh.py", "model.py"):
        assert "pathlib" not in set(imports(path))


def test_help_imports_nothing_slow():
    """`pipeline --help` answers before numpy would be there."""
    code = (
        "import sys, pipeline.app.cli\n"
        "try: pipeline.app.cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        f"print([name for name in {LATE!r} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent
    )

    assert "run" in done.stdout
    assert done.stderr.strip() == "[]"


def test_prefect_is_imported_by_flow_and_server_only():
    """The flow and the server: everything else is as true without it."""
    knowing = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if any(name.split(".")[0] == "prefect" for name in imports(path))
    }

    assert knowing == {"app/flow.py", "app/gate.py"}


def test_matplotlib_is_imported_behind_one_door():
    """Which keeps it from the settings of the current folder: svg.py, before any figure."""
    knowing = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if any(name.split(".")[0] == "matplotlib" for name in imports(path))
    }
    door = "import pipeline.report.svg"

    assert {one for one in knowing if not one.startswith("report/figures/")} == {"report/svg.py"}
    assert door in (PACKAGE / "report" / "figures" / "__init__.py").read_text("utf-8")


def test_no_two_files_import_each_other():
    """Whatever a file uses stands below it, also what is imported late."""
    known = {
        ".".join(("pipeline", *path.relative_to(PACKAGE).with_suffix("").parts)): path
        for path in PACKAGE.rglob("*.py")
    }

    graphlib.TopologicalSorter(
        {name: used(path) & set(known) for name, path in known.items()}
    ).prepare()


ORDER = (
    "base",
    "machine",
    "programs",
    "tables",
    "readers",
    "reduction",
    "store",
    "system",
    "wear",
    "geometry",
    "faults",
    "diagnosis",
    "prediction",
    "design",
    "simulate",
    "answer",
    "report",
    "run",
    "library",
    "page",
    "app",
)
"""Packages and files at the top, each importing only what stands before it."""


def test_every_package_imports_only_those_below_it():
    """The order of docs/code.md, also of what is imported late."""
    for path in PACKAGE.rglob("*.py"):
        mine = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if mine.startswith("__"):
            continue
        others = {m.split(".")[1] for m in used(path) if m and m.startswith("pipeline.")}
        above = [other for other in others & set(ORDER) if ORDER.index(other) > ORDER.index(mine)]
        assert not above, path


def used(path):
    """Modules, and what may be one: `from pipeline import files` uses pipeline.files."""
    froms = [node for node in nodes(path) if isinstance(node, ast.ImportFrom) and not node.level]
    return {f"{node.module}.{name.name}" for node in froms for name in node.names} | set(
        imports(path)
    )
