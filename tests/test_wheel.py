"""The wheel alone: in an empty environment and an empty folder, without the clone."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "CITATION.cff")
ALONE = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")


def run(*words, cwd, **more):
    """Run a command that must succeed; return its stdout."""
    clean = {name: value for name, value in os.environ.items() if name not in ALONE}
    done = subprocess.run(
        [*map(str, words)], cwd=cwd, env=clean | more, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{words}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout


def built(copy, mode=None):
    """The wheel, built by setuptools from a copy of the sources."""
    shutil.copytree(ROOT / "pipeline", copy / "pipeline",
                    ignore=shutil.ignore_patterns("__pycache__"))  # fmt: skip
    for name in SOURCES:
        shutil.copy(ROOT / name, copy)
    if mode:
        for path in filter(Path.is_file, copy.rglob("*")):
            path.chmod(mode)
            os.utime(path, (1.6e9, 1.6e9))
    run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation",
        "--no-index", "-w", copy / "dist", copy, cwd=copy)  # fmt: skip
    (made,) = (copy / "dist").glob("*.whl")
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of the clone as it is."""
    return built(tmp_path_factory.mktemp("sources"))


@pytest.mark.slow
def test_the_wheel_depends_on_the_sources_alone(wheel, tmp_path):
    """A clone of another folder, day and umask: the same bytes."""
    assert built(tmp_path, mode=0o600).read_bytes() == wheel.read_bytes()


@pytest.mark.slow
def test_every_file_of_the_package_is_in_the_wheel(wheel):
    """Robots, templates, styles and py.typed are packed; tests and data are not."""
    inside = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    there = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "pipeline").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }

    assert inside == there


@pytest.mark.slow
@pytest.mark.timeout(2400)  # two minutes of processor time, mostly pip's
def test_the_wheel_runs_a_campaign_by_itself(wheel, tmp_path):
    """Installed with the locked libraries only, it simulates, runs and is imported."""
    run(sys.executable, "-m", "venv", "venv", cwd=tmp_path)
    python = tmp_path / "venv" / "bin" / "python"
    pip = (python, "-m", "pip", "install", "-q", "--no-deps", "--no-compile")
    run(*pip, "--require-hashes", "--only-binary", ":all:", "-r", ROOT / "requirements.lock",
        cwd=tmp_path)  # fmt: skip
    run(*pip, "--no-index", wheel, cwd=tmp_path)
    run(python, "-m", "pip", "check", cwd=tmp_path)
    empty = tmp_path / "empty"
    empty.mkdir()
    command = tmp_path / "venv" / "bin" / "pipeline"

    run(command, "simulate", "--name", "first", cwd=empty)
    said = json.loads(run(command, "run", "first", "--engine", "local", "--json", cwd=empty))
    code = ("import json, pipeline; r = pipeline.identify(pipeline.load_campaign('first'));"
            "print(json.dumps([r.verdict, pipeline.__file__, r.stiffness[1].value]))")  # fmt: skip
    verdict, file, value = json.loads(run(python, "-c", code, cwd=empty))

    assert said["diagnosis"]["verdict"] == verdict == "adequate"
    assert value == pytest.approx(said["stiffness"][1]["value"], rel=1e-8)
    assert Path(file).is_relative_to(tmp_path / "venv")
    reports = empty / "reports" / "first"
    assert all((reports / name).stat().st_size > 1000 for name in ("index.html", "report.pdf"))
