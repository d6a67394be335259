"""The architecture, checked by the imports of the code."""

import ast
import builtins
import functools
import graphlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.app.commands import COMMANDS

pytestmark = pytest.mark.xdist_group("architecture")  # every file is parsed once

PACKAGE = Path(__file__).parents[1] / "pipeline"
PURE = (
    "machine",
    "check",
    "dialects",
    "exchange",
    "programs",
    "readers",
    "reduction",
    "system",
    "faults",
    "diagnosis",
    "prediction",
    "answer",
    "positions",
    "design",
    "simulate",
    "geometry",
    "fleet/wear",
    "intake",
)
"""Folders without screen, disk or shell, in the core or beside it; but for `SPEAKING`."""
SPEAKING = (
    "command.py",
    "predict.py",
    "plan_files.py",
    "plan_figures.py",
    "on_disk.py",
    "library.py",
    "report.py",
    "describe_file.py",
    "asking.py",
    "blank.py",
    "archive.py",
)
"""Files of these that parse, draw, or take paths: they offer the parts of outbuildings."""
OUTSIDE = {"prefect", "typer", "matplotlib", "filelock", "jinja2", "typst"}
LATE = ("pinocchio", "prefect", "matplotlib", "scipy", "pandas", "pyarrow", "numpy")


@functools.cache
def statements(path):
    """All statements of a file, also inside functions; expressions would be ten times as many."""
    found = [ast.parse(path.read_text("utf-8"))]
    for one in found:
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            found += getattr(one, part, ())
    return tuple(found)


def imports(path):
    """Every module that a file imports, also inside functions."""
    for node in statements(path):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module


def short(path):
    """As in the tables of docs/code.md, below the package."""
    return path.relative_to(PACKAGE).as_posix()


FILES = sorted(p for part in PURE for p in (PACKAGE / part).rglob("*.py") if p.name not in SPEAKING)


def test_the_core_knows_no_shell():
    """Physics, statistics and the like import nothing that runs, draws or prints."""
    roots = {short(path): {name.split(".")[0] for name in imports(path)} for path in FILES}

    assert not {path: found & OUTSIDE for path, found in roots.items() if found & OUTSIDE}, (
        "screen and disk are for `app`, `store`, `report` and the files in SPEAKING"
    )


def test_the_core_does_not_open_files():
    """Bytes are passed as values; only robot and model files are found by path."""
    texts = {path: path.read_text("utf-8") for path in FILES}
    calls = {
        (path, node.func.id)
        for path, text in texts.items()
        if re.search(r"\b(open|print)\(", text)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    by_path = {path for path in FILES if path.name != "mdh.py" and "pathlib" in set(imports(path))}

    assert not {(short(path), name) for path, name in calls if name in ("open", "print")}, (
        "return it; `app`, `store` and the files in SPEAKING print and write"
    )
    assert not [short(path) for path in by_path], "take bytes instead of a path"


@pytest.mark.parametrize(
    ("words", "around"),
    [
        (["--help"], {}),
        ([], {"_PIPELINE_COMPLETE": "complete_bash", "COMP_WORDS": "pipeline ", "COMP_CWORD": "1"}),
    ],
    ids=["help", "completion"],
)
def test_commands_are_listed_without_slow_imports(words, around):
    """`pipeline --help`, and shell completion, list the names before numpy could be imported."""
    code = (
        "import sys, pipeline.app.cli\n"
        f"try: pipeline.app.cli.main({words!r})\n"
        "except SystemExit: pass\n"
        f"print([name for name in {LATE!r} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=PACKAGE.parent,
        env={**os.environ, **around},
    )

    assert ("Usage" in done.stdout) is not bool(around)
    assert {*COMMANDS} <= {*done.stdout.split()}
    assert done.stderr.strip() == "[]"


def test_prefect_is_imported_by_flow_and_gate_only():
    """By the flow, and the gate to its page; everything else works without it."""
    knowing = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if any(name.split(".")[0] == "prefect" for name in imports(path))
    }

    assert knowing == {"service/flow.py", "service/gate.py"}


def test_matplotlib_is_imported_behind_one_door():
    """It keeps Matplotlib from the settings of the current folder: svg.py, before any figure."""
    knowing = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if any(name.split(".")[0] == "matplotlib" for name in imports(path))
    }
    figures = PACKAGE / "report/figures/__init__.py"

    assert {
        one for one in knowing if not one.startswith(("report/figures/", "annex/figures/"))
    } == {
        "report/svg.py",
        "design/plan_figures.py",
        "fleet/course.py",
    }
    assert "import pipeline.report.svg" in figures.read_text("utf-8")
    assert "import pipeline.report.svg" in (PACKAGE / "annex/figures/__init__.py").read_text(
        "utf-8"
    )
    for name in ("design/plan_figures.py", "fleet/course.py"):
        order = [n.module for n in statements(PACKAGE / name) if isinstance(n, ast.ImportFrom)]
        assert order.index("pipeline.report.svg") < order.index("matplotlib.axes")


def test_no_two_files_import_each_other():
    """A file uses only what is below it, also in late imports."""
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
    "tables",
    "readers",
    "reduction",
    "store",
    "system",
    "geometry",
    "faults",
    "diagnosis",
    "prediction",
    "answer",
    "report",
    "run",
    "app",
)
"""Packages and files of the core, each importing only preceding ones."""

OPEN = ("base", "machine", "tables", "answer.contract", "library")
"""What an outbuilding may import; the library is itself one, common to the others."""

_COMMAND = "how options are written and answers are shown, the same for every command"
_PLACES = "where a campaign lies, what may be written there, and how"
_PAGES = "its pages are made of the records, the columns and the colours of the report"

OUTBUILDINGS = {
    "annex": {
        "report": _PAGES,
        "answer": "its captions are in the words of the answer",
        "diagnosis.facts": "and its lines at the thresholds of the tests",
        "diagnosis.finding": "the verdicts by name",
        "prediction.decision": "and the decisions on a tolerance",
        "diagnosis.average": "what single pulls say of a law is asked of the likeliest hypothesis",
        "reduction": "and of its readings",
        "system": "what fewer poses would say, of the estimator",
        "positions": "and where a robot stood whose positions were read",
        "prediction.model": "and what the model of it says of other poses",
    },
    "design": {
        "app.commands._shared": _COMMAND,
        "store.campaign": _PLACES,
        "answer.words": _PAGES,
        "report": _PAGES,
        "annex.figures.marks": _PAGES,
        "annex.words": _PAGES,
        "annex.redundancy": "readings of a plan check each other as those of a campaign do",
        "reduction.settings": "a plan becomes a campaign.toml, and is written in its words",
        "reduction.bring": "further poses begin with the readings that a campaign has",
        "run": "further poses begin with the readings that a campaign has",
        "reduction.measured": "and are weighed beside its pulls",
        "system": "a plan is judged by the estimator that will read it",
        "diagnosis": "and by what the diagnosis will be able to tell apart",
        "geometry.unloaded": "and unloaded poses by the table that they will determine",
        "programs.for_plan": "a plan is driven by a program, in the languages that are read there",
    },
    "check": {
        "app.commands._shared": _COMMAND,
        "app.outcome": _COMMAND,
        "store.campaign": _PLACES,
        "run": "it reads a campaign as `run` does",
        "readers": "what logs remark, and the words that an export may contradict",
        "reduction": "it says what would be used of the readings",
        "system": "unloaded reflectors are held against the table as `run` does",
        "faults": "what is wrong is found by the same tests, so that `run` says the same",
        "diagnosis": "and named by the same findings",
        "answer": "and said in the same sentences",
        "prediction": "the path of a tolerance is read, and its forces held against the pulls",
    },
    "dialects": {"readers": "a dialect is a reader over the readers' one table of rows"},
    "exchange": {
        "answer.words": _PAGES,
        "report": _PAGES,
        "prediction.model": "the identified springs are what simulators are given",
        "readers._text": "tables of robots come in any encoding, and in workbooks",
    },
    "fleet": {
        "app.commands._shared": _COMMAND,
        "app.shell": _COMMAND,
        "app.outcome": _COMMAND,
        "store.campaign": _PLACES,
        "answer.archive": "which answers are finished, and where their tables lie",
        "diagnosis.finding": "the verdicts by name",
        "diagnosis.average": "from which probability on a cause counts as likely",
        "report": _PAGES,
    },
    "library": {
        "run": "it identifies campaigns",
        "answer.archive": "or takes the answer that is there",
        "store.campaign": _PLACES,
        "prediction": "and predicts from the model of the answer",
        "positions": "and where the robot stands, from that of its positions",
        "report": "its figures are those of the report",
    },
    "house": {"store.campaign": "a line may quote the digest of result.json"},
    "intake": {
        "app.commands._shared": _COMMAND,
        "app.outcome": _COMMAND,
        "store.campaign": _PLACES,
        "readers": "it says what a reader will be told, and tries it",
        "dialects": "in the words of titles, units and coordinates that are read there",
        "reduction.settings": "it writes campaign.toml",
        "reduction.limits": "whether a robot can stand where a log says",
    },
    "live": {
        "readers.logs": "which of the planned poses nothing was read of yet",
        "run": "readings in between are read as `run` does",
        "reduction": "and come to displacements as there",
        "faults": "each new one is held against what is known by the same tests",
        "system": "and the springs are estimated from all of them",
        "prediction": "what these predict decides on the tolerance",
        "answer.conformity": "and is said as in the answer",
    },
    "page": {
        "app.commands._shared": _COMMAND,
        "store.campaign": _PLACES,
        "answer": "it shows the answer that is there, in its words",
    },
    "positions": {
        "app.outcome": _COMMAND,
        "store.campaign": _PLACES,
        "reduction": "tables of positions are cases, and its pulls reduced as all are",
        "system": "springs of both kinds stand in one estimate",
        "geometry": "positions have the columns of unloaded reflectors",
        "faults": "their mistakes are found as those of pulls are",
        "readers": "their tables are logs of joint values",
        "diagnosis": "and judged by the same verdict",
        "prediction.model": "the model that it hands over",
        "answer": "an answer is that of a campaign of pulls, with what only positions say",
    },
    "programs": {
        "reduction.limits": "how far beyond its limit a joint was mistyped",
        "app.commands._shared": _COMMAND,
        "store.campaign": _PLACES,
        "prediction": "a program is a path of targets: aimed at and compensated as any other",
        "readers.logs": "paths and poses are tables of joint values, as logs and positions are",
        "readers.export_settings": "named as we name them",
    },
    "service": {
        "app.commands._shared": _COMMAND,
        "app.outcome": _COMMAND,
        "app.progress": _COMMAND,
        "store.campaign": _PLACES,
        "answer.archive": "which answers are finished, and the page over them",
        "answer.remarks": "and stiffnesses in its words",
        "report": _PAGES,
        "readers": "how large an export may be that is copied from a storage",
        "run": "it runs campaigns",
    },
    "simulate": {
        "design.poses": "poses are drawn where a plan would draw them",
        "design.pull": "and pulled as hard as there",
        "app.commands._shared": _COMMAND,
        "store.campaign": _PLACES,
        "readers": "what is simulated is written in the dialects that are read",
        "reduction.settings": "a plan becomes a campaign.toml, and is written in its words",
    },
}
"""Folders without which the core works: what each imports in addition, and why."""


KNOWN = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")
    for path in PACKAGE.rglob("*.py")
}


def modules(path):
    """Modules of the package that a file imports, without the name of the package."""
    for node in statements(path):
        if isinstance(node, ast.Import):
            whole = [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            whole = [f"{node.module}.{name.name}" for name in node.names]
        else:
            continue
        for one in whole:
            root, _, inner = one.partition(".")
            if root == PACKAGE.name:
                yield inner if inner in KNOWN else inner.rpartition(".")[0]


def leads_into(module, rooms):
    """Whether a module is one of these, or inside one."""
    return any(module == room or module.startswith(f"{room}.") for room in rooms)


def test_every_folder_is_core_or_outbuilding():
    """Each is in one of them, and thus in a test of this file."""
    there = {path.relative_to(PACKAGE).parts[0] for path in PACKAGE.rglob("*.py")}

    assert {one.removesuffix(".py") for one in there} - {"__init__", "__main__"} == {
        *ORDER,
        *OUTBUILDINGS,
    }, "write a new one into ORDER or OUTBUILDINGS, and into the same table of docs/code.md"


def test_the_picture_of_the_code_shows_every_package():
    """Each within its frame: `make picture` draws it again."""
    svg = (PACKAGE.parent / "docs/figures/packages.svg").read_text("utf-8")
    *_, width, height = map(float, re.search(r'viewBox="([^"]+)"', svg)[1].split())
    drawn = re.findall(r'x="([-.\d]+)" y="([-.\d]+)" transform=[^>]*>(\w+)  \d+<', svg)

    assert {name for *_, name in drawn} == {*ORDER, *OUTBUILDINGS}
    assert [name for x, y, name in drawn if not 0 < float(x) < width] == []
    assert [name for x, y, name in drawn if not 0 < float(y) < height] == []


def test_every_package_imports_only_those_below_it():
    """The order of docs/code.md, also for late imports; and thus no outbuilding."""
    for path in PACKAGE.rglob("*.py"):
        mine = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if mine not in ORDER:
            continue
        others = {module.split(".")[0] for module in modules(path)}
        below = {*ORDER[: ORDER.index(mine) + 1], "__version__"}
        assert not (others & {*ORDER, *OUTBUILDINGS}) - below, (
            f"{short(path)} may import of the core: {', '.join(sorted(below))}; "
            "what an outbuilding offers it finds by a door (base/doors.py)"
        )


@pytest.mark.parametrize("name", OUTBUILDINGS)
def test_an_outbuilding_imports_what_is_open_or_listed(name):
    """It imports itself, what is open to all, and its list, of which every item is used."""
    rooms = (name, *OPEN, *OUTBUILDINGS[name])
    found = {one for path in (PACKAGE / name).rglob("*.py") for one in modules(path)}

    assert not {one for one in found if not leads_into(one, rooms)}, (
        f"list it, with the reason, under {name} of OUTBUILDINGS, or go without"
    )
    assert not [
        one for one in OUTBUILDINGS[name] if not any(leads_into(m, [one]) for m in found)
    ], f"no longer imported: take it out of {name} in OUTBUILDINGS"


@pytest.mark.parametrize("name", OUTBUILDINGS)
def test_an_outbuilding_has_a_first_page(name):
    """What it is, its door, and how it is tested."""
    page = ast.get_docstring(ast.parse((PACKAGE / name / "__init__.py").read_text("utf-8")))

    assert page.startswith("Outbuilding: ")
    assert re.search(r"(?m)^Door: ", page)
    assert re.search(r"(?m)^Tests: ", page)


def without(folder, names):
    """A copy of the package without these outbuildings, and a project with the demo."""
    kept = shutil.ignore_patterns("__pycache__", *names)
    shutil.copytree(PACKAGE, folder / "pipeline", ignore=lambda at, found: kept(at, found) if
                    Path(at) == PACKAGE else {"__pycache__"} & {*found})  # fmt: skip
    shutil.copytree(PACKAGE.parent / "data/raw/kr500_demo", folder / "data/raw/kr500_demo")


ALONE = """
import sys
sys.meta_path[:] = [one for one in sys.meta_path if "editable" not in repr(one).lower()]
sys.path[0] = {folder!r}
from pipeline.app.cli import main
main({words!r})
"""
"""The command line of a copy, without access to the installed package."""


def command(folder, *words):
    """`pipeline` of the copy in this folder."""
    return subprocess.run(
        [sys.executable, "-c", ALONE.format(folder=str(folder), words=[*words])],
        capture_output=True,
        text=True,
        cwd=folder,
    )


SETS = [[*OUTBUILDINGS], *([name] for name in OUTBUILDINGS)]


@pytest.mark.whole
@pytest.mark.parametrize("names", SETS, ids=["all", *OUTBUILDINGS])
def test_the_core_runs_without(tmp_path, names):
    """The demo gives its report, and a missing command is reported as such."""
    without(tmp_path, names)
    engine = [] if "service" in names else ["--engine", "local"]
    done = command(tmp_path, "run", "kr500_demo", *engine)

    assert done.returncode == 0, done.stderr
    assert (tmp_path / "reports/kr500_demo/report.pdf").is_file()
    listed = command(tmp_path, "--help").stdout
    gone = [word for word, one in COMMANDS.items() if one.door.split(".")[1] in names]
    assert gone == [word for word in COMMANDS if f"\n  {word} " not in listed]
    if gone:
        refused = command(tmp_path, gone[0])
        assert refused.returncode == 2
        assert "comes without pipeline." in refused.stderr


def used(path):
    """Modules, and names that may be modules: `from pipeline import files` uses pipeline.files."""
    froms = [
        node for node in statements(path) if isinstance(node, ast.ImportFrom) and not node.level
    ]
    return {f"{node.module}.{name.name}" for node in froms for name in node.names} | set(
        imports(path)
    )


def names_of(path):
    """What a file defines or imports at its top level."""
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (one.id for one in targets if isinstance(one, ast.Name))


@functools.cache
def texts():
    """The text of every file of the package."""
    return {path: path.read_text("utf-8") for path in sorted(PACKAGE.rglob("*.py"))}


def test_a_module_that_a_text_names_exists():
    """`system.score_tests` in a docstring is a file, or a name of the package, also tomorrow."""
    folders = {path.name: path for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    missing = [
        f"{short(path)}: {room}.{name}"
        for path, text in texts().items()
        for room, name in re.findall(r"`([a-z]+)\.([a-z_]+)(?:[.:]\w+)?`", text)
        if room in folders and name not in ("toml", "py")
        if not {f"{room}.{name}"} & KNOWN and not (folders[room] / name).is_dir()
        if name not in names_of(folders[room] / "__init__.py")
    ]

    assert not missing


def test_an_error_that_a_docstring_announces_exists():
    """A class of the package, of Python or of NumPy."""
    known = {name for text in texts().values() for name in re.findall(r"^class (\w+)", text, re.M)}
    known |= {*vars(builtins), "LinAlgError"}
    announced = {
        (short(path), name)
        for path, text in texts().items()
        for part in re.findall(r"^ +Raises:\n((?: +\S.*\n)+)", text, re.M)
        for name in re.findall(r"^ +([A-Z]\w+):", part, re.M)
    }

    assert len(announced) > 100
    assert {one for one in announced if one[1] not in known} == set()


def test_a_file_that_a_first_page_names_exists():
    """In its room, or at its path from the top."""
    pages = [(path.parent, path.read_text("utf-8")) for path in PACKAGE.rglob("__init__.py")]
    named = [(at, one) for at, page in pages for one in re.findall(r"`([a-z_/]+\.py)`", page)]
    tops = (PACKAGE, PACKAGE.parent)
    lost = [one for at, one in named if not any((up / one).is_file() for up in (at, *tops))]

    assert len(named) > 30
    assert lost == []


def test_a_class_of_the_core_has_its_name_alone():
    """One noun for one thing."""
    seen = {}
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0] in OUTBUILDINGS:
            continue
        for node in statements(path):
            if isinstance(node, ast.ClassDef):
                seen.setdefault(node.name, []).append(path.relative_to(PACKAGE).as_posix())

    assert not {name: where for name, where in seen.items() if len(where) > 1}, "rename one"


def code_lines(path):
    """Lines of code: neither blank, nor a comment, nor of a docstring."""
    lines = path.read_text("utf-8").splitlines()
    said = {
        k
        for node in statements(path)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        for k in range(node.lineno, node.end_lineno + 1)
    }
    counted = [line for k, line in enumerate(lines, 1) if k not in said]
    return sum(bool(line.strip()) and not line.lstrip().startswith("#") for line in counted)


def test_the_core_does_not_grow():
    """What is added to it takes the place of something, or stands in an outbuilding."""
    core = [
        path
        for path in PACKAGE.rglob("*.py")
        if path.relative_to(PACKAGE).parts[0] not in OUTBUILDINGS
    ]

    assert sum(map(code_lines, core)) <= 29_000
    assert len(core) <= 260


WHOLE = {"run", "app", "pipeline"}
"""Imports, the package itself among them, of tests that play a campaign or type a command."""
BESIDE = {"dialects": {"readers"}, "validation": {"bench"}}
"""Folders of tests that also test through or of another room: dialects are read through `readers`,
and `validation` keeps what other tools said."""


def rooms_of(path):
    """Rooms that a file of tests imports at its top, `bench` among them, also from other tests."""
    text = path.read_text("utf-8")
    froms = re.findall(r"^from pipeline import (\([^)]*|.*)", text, re.MULTILINE)
    inner = re.findall(r"^(?:from|import) (?:pipeline|tests)\.(\w+)", text, re.MULTILINE)
    whole = re.findall(r"^(?:import (pipeline)$|from (bench)\b)", text, re.MULTILINE)
    return {name for one in froms for name in re.findall(r"\w+", one)} | {
        *inner,
        *("".join(one) for one in whole),
    }


def test_a_file_of_tests_stands_in_the_room_that_it_tests():
    """It imports from there, plays whole campaigns, or leaves all imports to its helpers."""
    folder = Path(__file__).parent
    misplaced = {}
    for path in sorted(folder.glob("*/**/test_*.py")):
        room, rooms = path.relative_to(folder).parts[0], rooms_of(path)
        if rooms - {"bench"} and not rooms & {room, *WHOLE, *BESIDE.get(room, ())}:
            misplaced[f"{room}/{path.name}"] = sorted(rooms)

    assert misplaced == {}, "move it beside the tests of the room that it imports"


def test_a_file_of_tests_has_its_name_alone():
    """Pytest imports each by its name, and confuses two with the same name."""
    paths = [*Path(__file__).parent.rglob("*.py")]
    names = [path.name for path in paths]

    assert not [str(path) for path in paths if names.count(path.name) > 1], "rename one"
