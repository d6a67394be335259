"""Whoever stands in a campaign's folder runs nothing that lies there and obeys no setting of it."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from test_serve import reported, serving, until

from bench.bench_service import free_port

HERE = Path(__file__).parents[2]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
MODULES = (
    *("asyncio", "matplotlib", "multiprocessing", "numpy", "prefect", "signal", "sitecustomize"),
    *("threading", "typing", "uvicorn"),
)
"""Of Python's own and of libraries: what processes of ours, and of those, import."""


@pytest.fixture
def trap(tmp_path):
    """A campaign whose folder has settings and modules for our libraries; each leaves a mark."""
    folder = tmp_path / "data" / "raw" / "x"
    shutil.copytree(KEPT, folder)
    for name in MODULES:
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / f'{name}.mark')!r}, 'w')\n")
    logs = folder / "logs.yml"
    touch = f"args: [touch, {tmp_path / 'settings.mark'}]"
    logs.write_text(f'version: 1\nformatters: {{a: {{"()": subprocess.check_output, {touch}}}}}\n')
    (folder / ".env").write_text(
        f"PREFECT_LOGGING_SETTINGS_PATH={logs}\nPREFECT_API_URL=http://127.0.0.1:9/api\n"
        f"PREFECT_PROFILES_PATH={folder / 'profiles.toml'}\n"
    )
    said = f'[{{}}]\nconfig_path = "{logs}"\n'
    (folder / "prefect.toml").write_text(said.format("logging"))
    (folder / "pyproject.toml").write_text(said.format("tool.prefect.logging"))
    (folder / "profiles.toml").write_text(
        f'active = "a"\n[profiles.a]\nPREFECT_LOGGING_SETTINGS_PATH = "{logs}"\n'
    )
    (folder / ".prefect").mkdir()  # where `pipeline run .` without --root has its project
    shutil.copy(logs, folder / ".prefect" / "logging.yml")
    shutil.copy(folder / "profiles.toml", folder / ".prefect")
    (folder / "matplotlibrc").write_text(
        "text.usetex: True\naxes.linewidth: 9\nlines.linewidth: 9\n"
    )
    return folder


@pytest.fixture
def script(tmp_path):
    """The command as it is installed, which does not take modules from the current folder."""
    path = tmp_path / "bin" / "pipeline"
    path.parent.mkdir()
    path.write_text("from pipeline.app.cli import main\nif __name__ == '__main__':\n    main()\n")
    return path


def carried_out(folder, *words):
    """A process in that folder, of a user who has set nothing."""
    unset = ("PREFECT_", "PIPELINE_", "PYTHON", "MPL", "MATPLOTLIB")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(unset)}
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=folder,
        env=clean | {"PYTHONPATH": str(HERE)},
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )


def marks(root):
    return [path.name for path in root.rglob("*.mark")]


@pytest.mark.slow
def test_matplotlib_takes_nothing_from_there(trap, script, tmp_path):
    """Pictures of `run` are those of a clean folder, without LaTeX and with its own lines."""
    plain = shutil.copytree(KEPT, tmp_path / "plain" / "data" / "raw" / "x")

    ran = carried_out(trap, script, "run", ".", "--root", tmp_path, "--engine", "local")
    carried_out(plain, script, "run", ".", "--root", tmp_path / "plain", "--engine", "local")
    ours, theirs = (
        {path.name: path.read_bytes() for path in (root / "reports/x/figures").glob("*.svg")}
        for root in (tmp_path, tmp_path / "plain")
    )

    assert ran.returncode == 0, ran.stderr
    assert len(ours) > 8
    assert ours == theirs
    assert marks(tmp_path) == []


@pytest.mark.sampled(1)
@pytest.mark.parametrize("module", ["svg", "figures.plot"])
def test_a_matplotlibrc_there_is_not_opened(tmp_path, module):
    """Whatever it says, and also where it cannot be read."""
    (tmp_path / "matplotlibrc").write_bytes(b"\xff\xfe")

    done = carried_out(tmp_path, "-c", f"import pipeline.report.{module}")

    assert (done.returncode, done.stderr) == (0, "")


def test_a_backend_of_another_name_is_no_error(tmp_path):
    """MPLBACKEND of a notebook that is not installed here, or misspelt; others still see it."""
    code = "import os; os.environ['MPLBACKEND'] = 'no such'; import pipeline.report.svg"

    done = carried_out(tmp_path, "-c", f"{code}; print(os.environ['MPLBACKEND'])")

    assert (done.stdout, done.stderr) == ("no such\n", "")


@pytest.mark.whole
def test_pictures_are_the_same_whatever_matplotlib_was_told(tmp_path):
    """Also in a program that has imported it itself, settings of that folder and all."""
    (tmp_path / "matplotlibrc").write_text("lines.linewidth: 9\naxes.linewidth: 9\n")
    code = (
        "import matplotlib; from pipeline.report.svg import drawn\n"
        "print(matplotlib.rcParams['lines.linewidth'])\n"
        "print(drawn('a', lambda c: c.subplots().plot([1, 2]) and {}).svg)"
    )

    told, plain = (carried_out(folder, "-c", code).stdout for folder in (tmp_path, HERE))

    assert told.partition("\n")[0] == "9.0"
    assert "<svg" in plain
    assert told.partition("\n")[2] == plain.partition("\n")[2]


@pytest.mark.whole
def test_processes_of_ours_take_no_module_from_there(trap, script, tmp_path):
    """`run --jobs` starts Python anew, which would look into the current folder first."""
    ran = carried_out(trap, script, "run", "x", "--root", tmp_path, "--jobs", 2, "--force")

    assert ran.returncode == 0, ran.stderr
    assert marks(tmp_path) == []


def test_no_folder_of_modules_is_looked_for_there(tmp_path):
    """Not by the way we are installed either: the words of an editable install would be a folder's.

    Python looks into each of these before any program begins, for sitecustomize.
    """
    said = carried_out(tmp_path, "-P", "-c", "import sys; print(*sys.path, sep='\\n')").stdout

    assert [line for line in said.split() if not Path(line).is_absolute()] == []


def test_python_m_takes_none_of_our_libraries_from_there(trap, tmp_path):
    """`python -m pipeline` has the current folder among its modules until we are there."""
    for name in ("pathlib", "typer", "pydantic", "json", "numpy"):
        (trap / f"{name}.py").write_text(f"open({str(tmp_path / f'{name}.mark')!r}, 'w')\n")

    ran = carried_out(trap, "-m", "pipeline", "robot", "--list")

    assert ran.returncode == 0, ran.stderr
    assert set(marks(tmp_path)) <= {"sitecustomize.mark"}, "which Python has before any program"


PEEK = """
import sys, types
from pathlib import Path

def identified(campaign, force):
    from prefect.settings import get_current_settings
    s = get_current_settings()
    print(s.api.url, s.profiles_path, s.logging.config_path, sep="\\n")

sys.modules["pipeline.service.flow"] = flow = types.ModuleType("pipeline.service.flow")
import contextlib
flow.identified, flow.telling = identified, contextlib.nullcontext
from pipeline.service import engine
from pipeline.store.campaign import find
engine.through_prefect(find(Path({root!r}), "."), True, str)
"""


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("root", [".", "../../.."])
def test_prefect_reads_no_settings_there(trap, tmp_path, root):
    """Neither its address nor its profile nor the settings of its logs are of that folder."""
    file = tmp_path / "peek.py"
    file.write_text(PEEK.format(root=root))

    url, profiles, logs = carried_out(trap, file).stdout.splitlines()

    assert url == "None"
    assert profiles == os.devnull
    assert Path(logs).parts[-3:] == ("prefect", "logging", "logging.yml")
    assert marks(tmp_path) == []


@pytest.mark.slow
@pytest.mark.prefect
@pytest.mark.xdist_group("prefect")
@pytest.mark.parametrize("root", ["../../..", "."])
def test_run_through_prefect_obeys_nothing_there(trap, script, tmp_path, root):
    """Prefect starts a server of its own, which takes neither settings nor modules from there."""
    ran = carried_out(trap, script, "run", ".", "--root", root, "--engine", "prefect")

    assert ran.returncode == 0, ran.stderr
    assert marks(tmp_path) == []


@pytest.mark.slow
@pytest.mark.prefect
@pytest.mark.xdist_group("prefect")
def test_serve_obeys_nothing_there(trap, script, tmp_path):
    """Nor do the processes of a service that is started there."""
    (tmp_path / "pipeline.toml").write_text("[service]\ninterval_s = 5\nquiet_s = 1\n")
    with serving(Path("../../.."), free_port(), signal.SIGINT, cwd=trap, script=script):
        until(lambda: reported(tmp_path, "x"), 150)

    assert marks(tmp_path) == []
