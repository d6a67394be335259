"""What README and docs show runs: their blocks, in a folder of their own, on real data."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter

import pytest
from shown_code import PAGES, ROOT, blocks

from pipeline.app.commands import COMMANDS

ALL = [block for page in PAGES for block in blocks(page)]
RUN = sorted({block.page for block in ALL if block.runs})


def test_every_block_is_found():
    """As many fences as the pages have, and no mark that speaks of no block."""
    text = "\n".join((ROOT / page).read_text("utf-8") for page in PAGES)
    marks = re.findall(r"(?m)^<!-- (?:given|file|exit|tested|not run): .*-->$", text)

    assert len(re.findall(r"(?m)^```(?!$)", text)) <= len(ALL)
    assert len(marks) == sum(len(block.marks) for block in ALL)
    assert {block.kind for block in ALL} == {"python", "sh", "toml", "json", "sql", ""}


def test_what_does_not_run_has_a_reason_and_is_rare():
    """Most of the code runs; of the rest it is said why, or which test has it."""
    code = [block for block in ALL if block.kind in ("python", "sh")]
    idle = [block for block in code if "not run" in block.marks]
    count = Counter(block.page for block in idle)

    assert all(len(block.marks["not run"].split()) >= 3 for block in idle)
    assert len(idle) <= 0.25 * len(code), count
    for block in code:
        if test := block.marks.get("tested"):
            assert block.page in (ROOT / test).read_text("utf-8"), block.at


@pytest.mark.parametrize("block", ALL, ids=lambda block: block.at)
def test_a_block_can_be_read(block):
    """Python compiles, TOML and JSON parse, and a shell's commands of ours are there."""
    if block.kind == "python":
        compile(block.code, block.at, "exec")
    elif block.kind == "toml" and not re.search(r"(?m)\?$|\.\.\.", block.code):
        tomllib.loads(block.code)
    elif block.kind == "json":
        json.loads(block.code)
    for word in re.findall(r"(?m)^(?:\$ )?pipeline ([a-z]+)", block.code):
        assert word in COMMANDS, block.at


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A folder with the data of the project, in which `pipeline` and `python` are ours."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    (tmp_path / "docs" / "tutorials").mkdir(parents=True)
    own = tmp_path / ".bin"
    own.mkdir()
    for name, words in (("pipeline", f'"{sys.executable}" -m pipeline'),
                        ("python", f'"{sys.executable}"'), ("xdg-open", "true")):  # fmt: skip
        (own / name).write_text(f'#!/bin/sh\nexec {words} "$@"\n')
        (own / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{own}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("BROWSER", "true")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return tmp_path


def shell(block):
    """The script of a block: what is about the clone itself is asked there, and costs nothing."""
    lines = ["set -e", block.marks.get("given", ""), *map(_in_the_clone, block.code.split("\n"))]
    return "\n".join(lines)


def _in_the_clone(line):
    """A line as it is, but make and pytest only say what they would do, where they work."""
    if line.startswith("make "):
        return f"make -n -C '{ROOT}' {line.removeprefix('make ')}"
    tests = line.removeprefix("python -m pytest ")
    if tests != line:
        words = "python -m pytest -m '' -q -p no:cacheprovider --collect-only"
        return f"(cd '{ROOT}' && {words} {tests}\n)"
    return line


def run(words, folder, at, wanted=0):
    """Run a command there; it returns what is said of it."""
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    said = f"{at}\n{done.stdout[-1500:]}\n{done.stderr[-3000:]}"
    assert done.returncode == wanted, said


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("page", RUN)
def test_the_blocks_of_a_page_run(page, project):
    """One behind the other, as somebody would type them who reads from top to bottom."""
    here, python = project / "docs/tutorials" if "tutorials" in page else project, []
    for block in blocks(page):
        if name := block.marks.get("file"):
            (here / name).write_text(block.code, "utf-8")
        elif block.runs and block.kind == "sh":
            run(["bash", "-c", shell(block)], here, block.at, int(block.marks.get("exit", 0)))
        elif block.runs:  # the Python of a page is one program
            run(["bash", "-ec", block.marks.get("given", "")], here, block.at)
            python.append(block.code)
    run([sys.executable, "-c", "\n".join(python)], here, page)
