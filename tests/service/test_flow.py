"""The flow: the same answer as the plain run, its trace in Prefect, and nothing on the screen."""

import contextlib
import json
import os
import re
import sqlite3
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from conftest import without_drawings

from pipeline.app import cli
from pipeline.run import run
from pipeline.service import server
from pipeline.store import campaign as campaigns

HERE = Path(__file__).parents[2]
STAGES = "select substr(name, 1, instr(name, '-') - 1), state_type from task_run"


def project(files, root, *names):
    """A project root with copies of a campaign."""
    for name in names:
        folder = root / "data" / "raw" / name
        folder.mkdir(parents=True)
        for file, content in files.items():
            (folder / file).write_bytes(content)
    return root


UNDRAWN = "import conftest\nwith conftest.without_drawings(): import pipeline.__main__"
START = {True: ["-m", "pipeline"], False: ["-c", UNDRAWN]}
"""The command line, with the figures of the report and without."""


@pytest.mark.prefect
@pytest.mark.xdist_group("prefect")
@pytest.mark.parametrize("drawn", [False, pytest.param(True, marks=pytest.mark.whole)])
def test_prefect_gives_the_answer_of_the_plain_run(small_campaign, tmp_path, drawn):
    """Two campaigns through Prefect, the first broken: one answer each, byte for byte our own."""
    root = project(small_campaign.files, tmp_path / "prefect", "broken", "good")
    plain = project(small_campaign.files, tmp_path / "plain", "good")
    (root / "data" / "raw" / "broken" / "joints.csv").write_bytes(b"no table at all")
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PREFECT_")}

    done = subprocess.run(
        [sys.executable, *START[drawn], "run", "--json", "--root", root],
        capture_output=True,
        text=True,
        cwd=HERE,
        env=environment | {"PYTHONPATH": f"{HERE}:{HERE / 'tests'}"},
        check=False,
    )
    ordered = []
    with contextlib.nullcontext() if drawn else without_drawings():
        alone = run(campaigns.find(plain, "good"), step=partial(noted, ordered))

    broken, good = (json.loads(line) for line in done.stdout.splitlines())
    assert done.returncode == 5
    said = broken["error"]["message"].replace("`", "'")  # on a terminal
    assert done.stderr.splitlines() == [f"broken: {said}"]
    assert good == alone.as_json()
    for name in ("result.json", "figures/prediction.svg"):
        ours, theirs = (where / "reports" / "good" / name for where in (plain, root))
        assert ours.read_bytes() == theirs.read_bytes()
    assert dict(kept(root, "select name, state_type from flow_run")) == {
        "broken": "FAILED",
        "good": "COMPLETED",
    }
    assert {"read", "ingest", "fit", "diagnose", "render"} <= set(ordered)
    both = [("read", "COMPLETED"), ("ingest", "FAILED")]  # of the broken one
    both += [(stage, "COMPLETED") for stage in ordered]
    assert kept(root, STAGES) == sorted(both)
    assert kept(root, "select key from artifact where key not null") == [
        ("good-report",),
        ("good-stiffness",),
    ]
    ((table,),) = kept(root, "select data from artifact where key = 'good-stiffness'")
    shown = json.loads(json.loads(table))
    assert good["recommended"]["model"] == "joint_springs"
    for row, entry in zip(shown, good["stiffness"], strict=True):
        assert row["joint"] == entry["name"]
        if entry["value"] is None:
            assert row["stiffness"] == "not determined"
            continue
        if entry["ci95"][1] is None:
            assert row["stiffness"].startswith("above")
            continue
        value, prefix = re.match(r"(\S+) ± \S+ ([kM])N(?:/m|·m/rad)$", row["stiffness"]).groups()
        of_one = {"k": 1e3, "M": 1e6}[prefix]
        assert abs(float(value) * of_one - entry["value"]) < 0.1 * entry["std"]
    assert kept(root, "select message from log where message like '%Traceback%'") == []


def noted(names, stage):
    """The stage as it is; its name is noted when it is carried out."""

    def carried_out(*given, **named):
        names.append(stage.__name__)
        return stage(*given, **named)

    return carried_out


def kept(root, question):
    """Rows of Prefect's own database."""
    with contextlib.closing(sqlite3.connect(root / ".prefect" / "prefect.db")) as base:
        return sorted(base.execute(question))


PLANNED = """
import os, sys
from datetime import UTC, datetime
from pathlib import Path
from pipeline.library.preferences import Service
from pipeline.service import server
server.settle(Path(sys.argv[1]))
from prefect.server.schemas.schedules import CronSchedule
from pipeline.service import flow
import asyncio
when = flow._planned(Service(cron="30 2 * * *"))["schedule"]
there = CronSchedule(cron=when.cron, timezone=when.timezone)
begin = datetime.fromisoformat(sys.argv[2])
for one in asyncio.run(there.get_dates(4, begin)):
    print(one.astimezone(UTC).strftime("%d %H:%M"))
"""


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("zone", "begin", "utc"),
    [
        # 29 March 2026 has no half past two in Berlin: once all the same, where Prefect puts it
        ("Europe/Berlin", "2026-03-27T12:00+00:00", "28 01:30, 29 00:30, 30 00:30, 31 00:30"),
        # 25 October has two: once
        ("Europe/Berlin", "2026-10-23T12:00+00:00", "24 00:30, 25 00:30, 26 01:30, 27 01:30"),
        ("Asia/Kolkata", "2026-03-27T12:00+00:00", "27 21:00, 28 21:00, 29 21:00, 30 21:00"),
        ("UTC", "2026-03-27T12:00+00:00", "28 02:30, 29 02:30, 30 02:30, 31 02:30"),
    ],
)
def test_a_cron_line_means_the_clock_on_the_wall(tmp_path, zone, begin, utc):
    """Of this machine, winter and summer; Prefect's own understanding of a bare line is UTC."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PREFECT_")}
    done = subprocess.run(
        [sys.executable, "-c", PLANNED, tmp_path, begin],
        capture_output=True,
        text=True,
        env=clean | {"TZ": zone, "PYTHONPATH": str(HERE)},
        timeout=300,
        check=False,
    )

    assert ", ".join(done.stdout.splitlines()) == utc, done.stderr


@pytest.mark.parametrize("address", ["http://127.0.0.1:9/api", "not an address"])
def test_a_server_that_does_not_answer_is_a_sentence(
    small_campaign, tmp_path, address, monkeypatch, capsys
):
    """Before Prefect is begun, which would end in an error of its own."""
    root = project(small_campaign.files, tmp_path, "a")
    for name in [one for one in os.environ if one.startswith("PREFECT_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PREFECT_API_URL", address)
    monkeypatch.setattr(server, "see_settings", None)  # would import it

    code = cli._exit_code(["run", "--root", str(root)])

    assert code == 2
    assert capsys.readouterr().err == (
        f"a: no Prefect server answers at {address}: start it, or correct PREFECT_API_URL.\n"
    )
