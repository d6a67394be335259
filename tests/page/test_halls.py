"""Four halls of others, from dropped files to the report in Chromium, and what goes wrong there."""

import io
import json
import shutil
import tomllib
import zipfile
from pathlib import Path

import pytest
from halls import HALLS
from test_in_a_browser import chromium, page, sound  # noqa: F401  # fixtures

from pipeline.app import cli

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
    tab.get_by_label("robot", exact=True).select_option(hall.robot)
    tab.get_by_text("answers are still missing").wait_for()
    tab.wait_for_load_state("networkidle")
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
    tab.wait_for_load_state("networkidle")
    while (confirm := tab.get_by_role("button", name="Confirm as proposed")).count():
        before = confirm.count()
        confirm.first.click()
        tab.wait_for_function(f"document.querySelectorAll('[data-confirm]').length < {before}")
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
