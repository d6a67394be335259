"""Four halls of others, from dropped files to the report in Chromium, and what goes wrong there."""

import contextlib
import io
import json
import shutil
import signal
import socket
import subprocess
import sys
import time
import tomllib
import zipfile
from pathlib import Path

import pytest
from halls import HALLS
from test_in_a_browser import DEMO, chromium, page, sound  # noqa: F401  # fixtures

from pipeline.app import cli
from pipeline.machine import robot as robots

pytestmark = pytest.mark.slow

PER_METRE = {"m": 1.0, "mm": 1e3, "in": 1 / 0.0254}


def drop(tab, files):
    """Files dropped onto the page, as a browser has them from the desktop."""
    tab.get_by_label("or choose them").set_input_files(
        [{"name": Path(name).name, "mimeType": "", "buffer": data} for name, data in files.items()]
    )


def begin(tab, name):
    tab.get_by_label("New campaign").fill(name)
    tab.keyboard.press("Enter")
    tab.wait_for_url("**/files")


def fill_in(tab, hall):
    """What somebody in that hall knows, in the unit of the drawing."""
    with tab.expect_navigation():  # other entries may follow from it
        tab.get_by_label("robot", exact=True).select_option(hall.robot)
    for table in ("base_frame", "tool"):
        section = tab.locator("section", has=tab.get_by_role("heading", name=table, exact=True))
        section.locator("select").select_option(hall.unit)
    for name, at in hall.places.items():
        for axis, value in zip("xyz", at, strict=True):
            typed = f"{value * PER_METRE[hall.unit]:.10g}"
            tab.get_by_label(f"{name} {axis}", exact=True).fill(
                typed.replace(".", ",") if "," in hall.said["sigma_n"] else typed
            )
        tab.keyboard.press("Tab")
    tab.get_by_label("sigma_n", exact=True).fill(hall.said["sigma_n"])
    tab.keyboard.press("Tab")
    while before := tab.get_by_role("button", name="Confirm as proposed").all():
        with tab.expect_navigation():
            before[0].click()
    tab.locator("#fields:not([aria-busy])").wait_for()
    tab.reload()
    tab.get_by_text("Nothing is missing").wait_for()


def compute(tab):
    """Check, run and the answer."""
    tab.get_by_role("link", name="Go on to the check").click()
    tab.get_by_role("button", name="Check").click()
    tab.get_by_text("Accepted as it is now").wait_for()
    tab.get_by_role("link", name="Go on to the run").click()
    tab.get_by_role("button", name="Run").click()
    tab.get_by_role("link", name="To the answer").click()
    tab.get_by_role("link", name="Open the report").wait_for()


def result(root, name):
    """result.json without what hangs on the hour and the folder."""
    found = json.loads((root / "reports" / name / "result.json").read_text())
    return {key: one for key, one in found.items() if key not in ("measured", "run_time_s")}


@pytest.mark.parametrize("name", HALLS)
def test_from_dropped_files_to_the_answer_of_the_commands(page, tmp_path, name):  # noqa: F811
    """Without a terminal; with one, from the same files and words, the same result.json."""
    hall = HALLS[name]()
    begin(page, name)
    if name == "analyzer":  # as a folder in an archive, below a folder
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            for path, data in hall.files.items():
                archive.writestr(path, data)
        drop(page, {"SA.zip": packed.getvalue()})
    else:
        drop(page, hall.files)
    page.get_by_role("button", name="These are all").wait_for()
    page.wait_for_load_state("networkidle")
    assert page.locator(".file").count() == len(hall.files)
    sound(page)
    page.get_by_role("button", name="These are all").click()
    page.wait_for_url("**/setup")
    fill_in(page, hall)
    sound(page)
    compute(page)
    sound(page)
    assert page.complaints == []

    there = tmp_path / "data" / "raw" / name
    assert tomllib.loads((there / "campaign.toml").read_text())["robot"] == hall.robot
    other = tmp_path / "commands"
    shutil.copytree(there, other / "data" / "raw" / name)
    for words in (["check", name], ["run", name, "--engine", "local"]):
        assert cli._exit_code([*words, "--root", str(other)]) == 0
    assert result(tmp_path, name) == result(other, name)


# --- what goes wrong ------------------------------------------------------------------------------


@pytest.fixture
def hall(page, tmp_path):  # noqa: F811
    """A campaign that is ready to be checked, as the terminal left it."""
    shutil.copytree(DEMO, tmp_path / "data" / "raw" / "hall")
    page.at = page.url.rstrip("/")
    return page


def contents(folder):
    return {one.name: one.read_bytes() for one in sorted(folder.iterdir())}


def test_a_wrong_file_is_said_and_can_be_removed(hall, tmp_path):
    """A picture; nothing else is lost by it."""
    before = contents(tmp_path / "data" / "raw" / "hall")
    hall.goto(f"{hall.at}/c/hall/files")
    drop(hall, {"robot photo.jpg": b"\xff\xd8\xff\xe0" + bytes(range(256)) * 40})
    section = hall.locator(".file", has_text="robot photo.jpg")
    section.get_by_text("Not used as it is").wait_for()
    section.get_by_role("button", name="remove").click()
    hall.wait_for_load_state("networkidle")
    section.wait_for(state="detached")

    assert contents(tmp_path / "data" / "raw" / "hall") == before


def test_a_file_dropped_twice_is_there_once_and_another_of_its_name_is_asked_about(hall, tmp_path):
    folder = tmp_path / "data" / "raw" / "hall"
    before = contents(folder)
    hall.goto(f"{hall.at}/c/hall/files")
    hall.get_by_text("344 readings").wait_for()
    drop(hall, {"tracker.csv": before["tracker.csv"]})
    hall.get_by_text("this file was there already").wait_for()
    assert contents(folder) == before

    asked = []
    hall.on("dialog", lambda one: (asked.append(one.message), one.dismiss()))
    drop(hall, {"tracker.csv": before["tracker.csv"] + b"\n"})
    hall.get_by_text("another file tracker.csv is in this campaign").wait_for()

    assert "Replace it?" in asked[0]
    assert contents(folder) == before


def test_a_robot_of_seven_axes_of_its_own_is_taken_from_its_file(hall, tmp_path):
    """On the rail, from a file that somebody wrote."""
    shipped = Path(robots.__file__).parent / "kr500_rail.toml"
    own = shipped.read_text().replace("KUKA KR500", "Hall 7: KR500")
    hall.goto(f"{hall.at}/c/hall/files")
    drop(hall, {"hall7.toml": own.encode()})
    hall.locator(".file", has_text="hall7.toml").get_by_text("robot file").wait_for()
    hall.goto(f"{hall.at}/c/hall/setup")
    hall.get_by_label("robot", exact=True).select_option("hall7.toml")
    hall.wait_for_load_state("networkidle")
    hall.get_by_text("Nothing is missing").wait_for()
    compute(hall)

    found = result(tmp_path, "hall")
    assert len(found["stiffness"]) == 7
    assert found["diagnosis"]["verdict"] == "adequate"


def test_two_hundred_megabytes_are_taken_and_more_are_refused_in_a_sentence(hall, tmp_path):
    """A log of a week is not read to its end by a page; nothing hangs."""
    folder = tmp_path / "data" / "raw" / "hall"
    before = contents(folder)
    row = b"A::other::X1, 1000.0000, 2000.0000, 3000.0000\n"
    week = tmp_path / "week.txt"
    week.write_bytes(row * (200 * 2**20 // len(row)))
    more = tmp_path / "year.txt"
    more.write_bytes(row * (260 * 2**20 // len(row)))
    hall.goto(f"{hall.at}/c/hall/files")
    hall.get_by_label("or choose them").set_input_files([more])
    hall.get_by_text("more than 256 MB are not taken here: split the file").wait_for()
    hall.get_by_label("or choose them").set_input_files([week])
    section = hall.locator(".file", has=hall.get_by_role("heading", name="week.txt"))
    section.locator("p:not(.muted)").first.wait_for()

    assert (folder / "week.txt").stat().st_size == week.stat().st_size
    section.get_by_role("button", name="remove").click()
    section.wait_for(state="detached")
    assert contents(folder) == before


def test_an_archive_that_unpacks_to_ten_gigabytes_is_refused(hall, tmp_path):
    before = contents(tmp_path / "data" / "raw" / "hall")
    packed = io.BytesIO()
    with (
        zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("points.csv", "w", force_zip64=True) as file,
    ):
        for _ in range(10 * 2**30 // 2**24):
            file.write(bytes(2**24))
    hall.goto(f"{hall.at}/c/hall/files")
    drop(hall, {"small.zip": packed.getvalue()})
    hall.get_by_text("the archive holds more than 256 MB").wait_for()

    assert contents(tmp_path / "data" / "raw" / "hall") == before


def test_a_tab_that_is_closed_while_it_runs_loses_nothing(hall, tmp_path):
    hall.goto(f"{hall.at}/c/hall/check")
    hall.get_by_role("button", name="Check").click()
    hall.get_by_text("Accepted as it is now").wait_for()
    hall.goto(f"{hall.at}/c/hall/run")
    hall.get_by_role("button", name="Run").click()
    hall.get_by_role("button", name="Cancel").wait_for()
    context = hall.context
    hall.close()
    again = context.new_page()
    again.goto(f"{hall.at}/c/hall/run")
    again.set_default_timeout(90_000)
    again.get_by_role("link", name="To the answer").wait_for()

    assert result(tmp_path, "hall")["diagnosis"]["verdict"] == "adequate"


def test_a_server_that_is_killed_in_a_run_is_said_and_begun_again(chromium, tmp_path):  # noqa: F811
    """The files are as they were, nothing is half written, and the next one computes it."""
    folder = tmp_path / "data" / "raw" / "hall"
    shutil.copytree(DEMO, folder)
    before = contents(folder)
    first, at = _served(tmp_path)
    tab = chromium.new_page()
    tab.set_default_timeout(90_000)
    tab.goto(at)
    home = tab.url.rstrip("/")
    tab.goto(f"{home}/c/hall/check")
    tab.get_by_role("button", name="Check").click()
    tab.get_by_text("Accepted as it is now").wait_for()
    tab.goto(f"{home}/c/hall/run")
    tab.get_by_role("button", name="Run").click()
    tab.get_by_text("computing").wait_for()
    first.send_signal(signal.SIGKILL)
    first.communicate(timeout=20)
    tab.get_by_text("the program behind this page does not answer").wait_for()

    assert contents(folder) == before
    written = tmp_path / "reports" / "hall" / "result.json"
    assert not written.exists() or json.loads(written.read_text())
    second, at = _served(tmp_path)
    tab.goto(at)
    home = tab.url.rstrip("/")
    tab.goto(f"{home}/c/hall/check")
    tab.get_by_role("button", name="Check").click()
    tab.get_by_text("Accepted as it is now").wait_for()
    tab.goto(f"{home}/c/hall/run")
    tab.get_by_role("button", name="Run").click()
    tab.get_by_role("link", name="To the answer").click()
    tab.get_by_role("link", name="Open the report").wait_for()
    second.send_signal(signal.SIGINT)
    second.communicate(timeout=20)
    tab.close()

    assert result(tmp_path, "hall")["diagnosis"]["verdict"] == "adequate"


def _served(root):
    """`pipeline page` as somebody starts it, and the address that it prints."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ("page", "--port", str(port), "--root", str(root))
    process = subprocess.Popen(
        [sys.executable, "-m", "pipeline", *words], stdout=subprocess.PIPE, text=True
    )
    at = process.stdout.readline().strip()
    for _ in range(200):
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
            break
        time.sleep(0.1)
    return process, at
