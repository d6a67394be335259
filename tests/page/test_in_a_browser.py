"""From dropped files to the report, by keyboard and mouse, in Chromium."""

import json
import os
import shutil
import socket
import threading
import time
import tomllib
from pathlib import Path

import pytest
import uvicorn

from pipeline.page import server

pytestmark = pytest.mark.slow

DEMO = Path(__file__).parents[2] / "data" / "raw" / "kr500_demo"


@pytest.fixture(scope="module")
def chromium():
    sync_api = pytest.importorskip("playwright.sync_api")
    path = os.environ.get("BROWSER_PATH") or shutil.which("chromium")
    if path is None:
        pytest.skip("no browser: install chromium (`apt-get install chromium`) or set BROWSER_PATH")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def page(chromium, tmp_path):
    with socket.socket() as free:
        free.bind((server.HERE, 0))
        port = free.getsockname()[1]
    pages = server.application(tmp_path, port, "t")
    running = uvicorn.Server(uvicorn.Config(pages, port=port, log_level="error"))
    thread = threading.Thread(target=running.run)
    thread.start()
    while not running.started:
        time.sleep(0.02)
    tab = chromium.new_context(viewport={"width": 1280, "height": 900}).new_page()
    tab.set_default_timeout(90_000)
    tab.complaints = []
    tab.on("pageerror", lambda error: tab.complaints.append(str(error)))
    tab.on(
        "console", lambda said: tab.complaints.append(said.text) if said.type == "error" else None
    )
    tab.goto(f"http://{server.HERE}:{port}/enter?token=t")
    yield tab
    tab.context.close()
    running.should_exit = True
    thread.join(20)


def sound(tab):
    """No violation of axe-core, whatever its impact."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(tab).response["violations"]
    assert not found, [(one["id"], one["nodes"][0]["html"]) for one in found]


def test_a_campaign_from_its_files_to_the_report(page, tmp_path):
    """Without a terminal: neither a script of the page nor axe-core complains."""
    said = tomllib.loads((DEMO / "campaign.toml").read_text())
    sound(page)
    page.get_by_label("New campaign").fill("hall 7")
    page.keyboard.press("Enter")
    page.wait_for_url("**/files")
    names = ("tracker.csv", "loads.csv", "joints.csv")
    page.get_by_label("or choose them").set_input_files([DEMO / name for name in names])
    page.get_by_text("344 readings").wait_for()
    sound(page)
    page.get_by_role("button", name="These are all").click()
    page.wait_for_url("**/setup")
    page.get_by_label("robot", exact=True).select_option("kr500_rail")
    for table in ("base_frame", "tool"):
        for name, at in said[table].items():
            for axis, value in zip("xyz", at, strict=True):
                page.get_by_label(f"{name} {axis}", exact=True).fill(str(value).replace(".", ","))
            page.keyboard.press("Tab")
    page.get_by_label("sigma_n", exact=True).fill("2,0")
    page.keyboard.press("Tab")
    page.wait_for_load_state("networkidle")
    page.reload()
    page.get_by_text("Nothing is missing").wait_for()
    sound(page)
    page.get_by_role("link", name="Go on to the check").click()
    page.get_by_role("button", name="Check").click()
    page.get_by_text("Accepted as it is now").wait_for()
    sound(page)
    page.get_by_role("link", name="Go on to the run").click()
    page.get_by_role("button", name="Run").click()
    page.get_by_role("link", name="To the answer").click()
    page.get_by_text("Joint springs explain the readings").wait_for()
    sound(page)
    for width in (400, 800):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width

    found = json.loads((tmp_path / "reports" / "hall 7" / "result.json").read_text())
    assert found["diagnosis"]["verdict"] == "adequate"
    written = tomllib.loads((tmp_path / "data" / "raw" / "hall 7" / "campaign.toml").read_text())
    assert written["tool"] == said["tool"]
    assert page.complaints == []


def test_rows_of_a_spreadsheet_can_be_pasted(page, tmp_path):
    """Names in front or not, decimal commas, millimetres."""
    folder = tmp_path / "data" / "raw" / "hall"
    folder.mkdir(parents=True)
    for name in ("tracker.csv", "loads.csv", "joints.csv"):
        shutil.copy(DEMO / name, folder)
    page.goto(page.url.rstrip("/") + "/c/hall/files")
    page.get_by_role("button", name="These are all").click()
    page.wait_for_url("**/setup")
    section = page.locator("section", has=page.get_by_role("heading", name="tool", exact=True))
    section.locator("select").select_option("mm")
    first = page.get_by_label("P1 x", exact=True)
    first.focus()
    first.evaluate("""(cell) => {
        const data = new DataTransfer();
        data.setData("text", "P2\\t-120,0\\t190,0\\t100,0\\nP1\\t200\\t50\\t120\\n");
        const paste = {clipboardData: data, bubbles: true, cancelable: true};
        cell.dispatchEvent(new ClipboardEvent("paste", paste));
    }""")
    page.wait_for_load_state("networkidle")
    page.wait_for_timeout(500)

    written = tomllib.loads((folder / "campaign.toml").read_text())["tool"]
    assert written["P1"] == [0.2, 0.05, 0.12]
    assert written["P2"] == [-0.12, 0.19, 0.1]


def test_a_column_is_something_else(page, tmp_path):
    """Chosen among the columns of the file, and read that way at once."""
    folder = tmp_path / "data" / "raw" / "hall"
    folder.mkdir(parents=True)
    rows = [one.split(",") for one in (DEMO / "tracker.csv").read_text().splitlines()[1:]]
    odd = [f"{r[0]};{r[1]};20.1;{r[2]};{r[3]};{r[4]};0.01" for r in rows]
    (folder / "odd.csv").write_text("\n".join(["G;P;T;U;V;W;S", *odd, ""]))
    page.goto(page.url.rstrip("/") + "/c/hall/files")
    page.get_by_text("Its columns", exact=True).click()
    sound(page)
    for number, role in enumerate(("group", "target", "", "x", "y", "z", ""), 1):
        page.get_by_label(f"column {number}", exact=True).select_option(role or "not used")
    page.get_by_role("button", name="Read it that way").click()
    page.get_by_text("as stated").first.wait_for(state="attached")
    page.get_by_text("Its columns", exact=True).click()

    written = tomllib.loads((folder / "campaign.toml").read_text())
    assert written["tracker"]["mapping"]["columns"]["x"] == "U"
    assert page.complaints == []


def test_two_windows_do_not_undo_each_other(page, tmp_path):
    """The second one to write is told, and nothing is lost."""
    shutil.copytree(DEMO, tmp_path / "data" / "raw" / "hall")
    here = page.url.rstrip("/") + "/c/hall/setup"
    other = page.context.new_page()
    for tab in (page, other):
        tab.goto(here)
    page.get_by_label("P1 x", exact=True).fill("0.21")
    page.keyboard.press("Tab")
    page.locator("input.kept").first.wait_for()
    other.get_by_label("P1 x", exact=True).fill("0.99")
    other.keyboard.press("Tab")
    other.get_by_text("was changed elsewhere").wait_for()

    text = (tmp_path / "data" / "raw" / "hall" / "campaign.toml").read_text()
    assert tomllib.loads(text)["tool"]["P1"][0] == 0.21


def test_an_answer_typed_just_before_going_on_is_written(page, tmp_path):
    """However slow the program is, the next page waits for it."""
    folder = tmp_path / "data" / "raw" / "hall"
    shutil.copytree(DEMO, folder)
    page.add_init_script("""const soon = window.fetch;
        window.fetch = async (...what) => {
            await new Promise((done) => setTimeout(done, 700));
            return soon(...what);
        };""")
    page.goto(page.url.rstrip("/") + "/c/hall/setup")
    page.get_by_label("P1 x", exact=True).fill("0.21")
    page.get_by_label("P2 x", exact=True).fill("0.22")
    page.get_by_role("link", name="Go on to the check").click()
    page.wait_for_url("**/check")

    written = tomllib.loads((folder / "campaign.toml").read_text())["tool"]
    assert (written["P1"][0], written["P2"][0]) == (0.21, 0.22)


def reach(tab, name, most=150, kind=None):
    """Tab until what has a name, and is an element of a kind, has the focus, which is seen."""
    for _ in range(most):
        tab.keyboard.press("Tab")
        at = tab.evaluate(
            """() => { const one = document.activeElement, style = getComputedStyle(one);
            const label = one.getAttribute("aria-label") || one.labels?.[0]?.textContent;
            return [(label || one.textContent).trim(), style.outlineStyle, one.tagName]; }"""
        )
        if at[0] == name and kind in (None, at[2]):
            assert at[1] != "none", at
            return
    raise AssertionError(f"{name} is not reached by {most} times Tab")


def test_by_the_keyboard_alone(page, tmp_path):
    """Tab, Enter, letters, from files to the report; only the system's dialog is answered."""
    said, keys = tomllib.loads((DEMO / "campaign.toml").read_text()), page.keyboard
    reach(page, "New campaign")
    keys.type("hall")
    keys.press("Enter")
    page.wait_for_url("**/files")
    with page.expect_file_chooser() as chooser:  # a busy browser is told of it after the next key
        reach(page, "or choose them")
        keys.press("Enter")
    chooser.value.set_files([DEMO / name for name in ("tracker.csv", "loads.csv", "joints.csv")])
    page.get_by_text("344 readings").wait_for()
    reach(page, "These are all: go on")
    keys.press("Enter")
    page.wait_for_url("**/setup")
    reach(page, "robot", kind="SELECT")  # a link above leads to it
    keys.press("ArrowDown")  # a list that is closed changes with every key
    keys.type("kr500_rail")
    page.wait_for_timeout(500)
    assert 'robot = "' not in (tmp_path / "data" / "raw" / "hall" / "campaign.toml").read_text()
    with page.expect_navigation():
        keys.press("Tab")
    assert page.evaluate("document.activeElement.labels[0].textContent") == "robot"
    for table in ("base_frame", "tool"):
        for name, at in said[table].items():
            for axis, value in zip("xyz", at, strict=True):
                reach(page, f"{name} {axis}")
                keys.type(str(value))
        if table == "base_frame":
            reach(page, "sigma_n")
            keys.type("2.0")
    keys.press("Tab")
    page.wait_for_load_state("networkidle")
    page.wait_for_timeout(500)
    reach(page, "Go on to the check")
    keys.press("Enter")
    page.wait_for_url("**/check")
    reach(page, "Check")
    keys.press("Enter")
    page.get_by_text("Accepted as it is now").wait_for()
    reach(page, "Go on to the run")
    keys.press("Enter")
    page.wait_for_url("**/run")
    reach(page, "Run")
    keys.press("Enter")
    page.get_by_role("link", name="To the answer").wait_for()
    reach(page, "To the answer")
    keys.press("Enter")
    page.wait_for_url("**/answer")
    reach(page, "Open the report")
    found = json.loads((tmp_path / "reports" / "hall" / "result.json").read_text())

    written = tomllib.loads((tmp_path / "data" / "raw" / "hall" / "campaign.toml").read_text())
    assert (written["robot"], written["tool"]) == ("kr500_rail", said["tool"])
    assert found["diagnosis"]["verdict"] == "adequate"
    assert page.complaints == []
