"""The cell in a real browser: it turns, zooms and picks, by mouse, by fingers and by keyboard."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib.resources import files as package_files

import numpy as np
import pytest
import report_sample
from get_browser import browser_path

from pipeline.report.render import render

# the sample is drawn once for all
pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("report")]

AXE = package_files("axe_playwright_python").joinpath("axe.min.js").read_text("utf-8")
WIDTHS = (360, 600, 768, 1024, 1280, 1600, 1920, 2560)


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    """Headless Chromium without WebGL, or a skip that says how to get it."""
    path = browser_path()
    if path is None:
        pytest.skip("no browser: install chromium (`apt-get install chromium`) or set BROWSER_PATH")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(
            executable_path=path, args=["--disable-gpu", "--disable-3d-apis"]
        )
        yield running
        running.close()


@pytest.fixture(scope="module")
def made() -> str:
    """A page of a campaign of sixteen poses, without the figures of other sections."""
    tables = report_sample.tables()
    cell = {name: tables[name] for name in ("scene", "poses", "vectors")}
    return render(report_sample.answer(), cell)["index.html"].decode()


@pytest.fixture(scope="module")
def whole() -> str:
    """The same page with all its figures."""
    return report_sample.rendered()["index.html"].decode()


@pytest.fixture
def opened(browser, made, tmp_path):
    """Opens the page; console messages and script errors are judged at the end."""
    contexts, wrong, usual = [], [], made

    def open_page(width=1280, scheme="light", motion="reduce", html=usual, **options):
        (tmp_path / "index.html").write_text(html, "utf-8")
        context = browser.new_context(
            viewport={"width": width, "height": 900},
            color_scheme=scheme,
            reduced_motion=motion,
            **options,
        )
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda said: wrong.append(f"console {said.type}: {said.text}"))
        page.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        page.goto((tmp_path / "index.html").as_uri())
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert wrong == []


def dots(page) -> np.ndarray:
    """Where the tips of all vectors are on the screen [px], shape (n, 2)."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    paths = page.evaluate(
        """() => [...document.querySelectorAll(".live .vector")].map((a) => a.getAttribute("d"))"""
    )
    tip = re.compile(r"L(-?[\d.]+) (-?[\d.]+)M")
    return np.array([[float(v) for v in tip.search(path).groups()] for path in paths])


def spread(points: np.ndarray) -> float:
    """How far apart they are."""
    return float(np.linalg.norm(points - points.mean(axis=0)))


def middle(page) -> tuple[float, float]:
    """Of the stage, in the window, after scrolling to it."""
    stage = page.locator(".stage")
    stage.scroll_into_view_if_needed()
    box = stage.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def says(page) -> str:
    """What is told of the pose that is picked."""
    return page.locator(".says").inner_text()


@pytest.mark.whole
def test_dragging_turns_the_cell(opened):
    """A drag to the side turns about the vertical: what was apart comes together, upright."""
    page = opened()
    x, y = middle(page)
    before = dots(page)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y, steps=4)
    page.mouse.up()
    after = dots(page)

    assert np.abs(after - before).max() > 50
    assert says(page).startswith("Pick a pose")  # a drag picks nothing
    vertical = page.evaluate(
        """() => document.querySelectorAll(".live .axis")[2].getAttribute("d")"""
    )
    assert re.search(r"l-?0\.0 -\d", vertical)  # z points upwards still


@pytest.mark.whole
def test_the_wheel_zooms_only_where_it_was_asked_to(opened):
    """Who scrolls past gets past; a click, and the wheel zooms about the pointer."""
    page = opened()
    x, y = middle(page)
    before = dots(page)
    page.mouse.move(x, y)
    page.mouse.wheel(0, -120)
    page.wait_for_timeout(100)

    assert np.array_equal(dots(page), before)
    x, y = middle(page)
    page.locator(".stage").focus()
    page.mouse.move(x, y)
    page.mouse.wheel(0, -300)
    assert spread(dots(page)) > 1.15 * spread(before)


@pytest.mark.whole
def test_keys_turn_zoom_pick_and_return(opened):
    """Whatever the mouse does the keyboard does; Tab goes on to the buttons."""
    page = opened()
    page.locator(".stage").focus()
    first = dots(page)
    page.keyboard.press("ArrowLeft")
    turned = dots(page)
    page.keyboard.press("+")
    larger = dots(page)
    page.keyboard.press("Home")
    again = dots(page)
    page.keyboard.press("n")
    page.keyboard.press("n")
    picked = says(page)
    page.keyboard.press("Enter")
    closer = dots(page)
    page.keyboard.press("Escape")
    none = says(page)
    page.keyboard.press("Tab")

    assert np.abs(turned - first).max() > 10
    assert spread(larger) == pytest.approx(1.25 * spread(turned), rel=0.01)
    assert np.abs(again - first).max() < 0.2
    assert picked.startswith(
        "Pose 2: tracker.csv lines 27\N{EN DASH}47, joints.csv line 3; 3 pulls up"
    )
    assert spread(closer) > 1.3 * spread(first)
    assert none == "No pose is picked."
    assert page.evaluate("document.activeElement.name") == "pose"


@pytest.mark.whole
def test_a_click_on_an_arm_picks_its_pose(opened):
    """The pose under the pointer is told with file, pulls, deflection and residual."""
    page = opened()
    middle(page)
    arm = page.locator(".live .arm[data-pose='4']").first
    spot = arm.evaluate(
        """(one) => { const b = one.getBoundingClientRect();
            for (let k = 1; k < 400; k++) {
                const x = b.x + b.width * ((k * 0.618) % 1), y = b.y + b.height * (k / 400);
                if (document.elementFromPoint(x, y) === one) return [x, y];
            } }"""
    )
    page.mouse.click(*spot)
    vectors = report_sample.tables()["vectors"].query("pose == 5")
    moved = np.linalg.norm(vectors[[f"moved_{a}_m" for a in "xyz"]], axis=1).max()

    assert says(page).startswith("Pose 5: tracker.csv")
    told = re.search(r"Largest deflection ([\d.]+)\s?mm at P\d, largest residual", says(page))
    assert float(told[1]) == pytest.approx(1e3 * moved, rel=5e-3)
    assert page.locator("select[name=pose]").input_value() == "4"
    assert page.locator(".live ellipse").count() == len(vectors)


@pytest.mark.whole
def test_a_list_picks_and_a_slider_magnifies(opened):
    """The same without a picture: a list of poses, and by how much vectors are magnified."""
    page = opened()
    page.locator("select[name=pose]").select_option("Pose 7")
    before = dots(page)
    slider = page.locator("input[name=moved]")
    said = slider.get_attribute("aria-valuetext")
    slider.focus()
    page.keyboard.press("ArrowRight")
    after = dots(page)

    assert says(page).startswith("Pose 7:")
    assert said != slider.get_attribute("aria-valuetext")
    moved, left = (np.abs(after - before)[k::2].max() for k in (0, 1))
    assert moved > 5
    assert left < 0.2
    page.locator("input[name=others]").uncheck()
    dots(page)  # drawn with the next frame
    assert page.locator(".live .arm:visible").count() == 2


@pytest.mark.whole
def test_two_fingers_zoom(opened):
    """A pinch zooms; one finger that moves upwards scrolls the page and is left to the browser."""
    page = opened(768, has_touch=True)
    x, y = middle(page)
    before = dots(page)
    page.evaluate(
        """([x, y]) => {
            const stage = document.querySelector(".stage");
            stage.setPointerCapture = () => {};
            const tell = (type, id, dx) => stage.dispatchEvent(new PointerEvent(type,
                { pointerId: id, pointerType: "touch", clientX: x + dx, clientY: y }));
            tell("pointerdown", 1, -50); tell("pointerdown", 2, 50);
            tell("pointermove", 1, -100); tell("pointermove", 2, 100);
            tell("pointerup", 1, -100); tell("pointerup", 2, 100);
        }""",
        [x, y],
    )

    assert spread(dots(page)) == pytest.approx(2 * spread(before), rel=0.02)
    assert (
        page.evaluate("getComputedStyle(document.querySelector('.stage')).touchAction") == "pan-y"
    )


@pytest.mark.whole
def test_the_page_sees_what_the_still_sees(opened, made):
    """The browser's projection and that of the still in the PDF agree to a pixel."""
    page = opened()
    numbers = json.loads(re.search(r'class="numbers">(.*?)</script>', made)[1])
    seen = dots(page)
    view, by = numbers["view"], numbers["magnify"]
    points = [one for pose in numbers["poses"] for one in pose["points"]]
    tips = np.array(
        [
            np.array(one[1:4]) + by[kind] * np.array(one[at : at + 3])
            for one in points
            for kind, at in (("moved", 4), ("left", 7))
        ]
    )
    forward = -np.array(
        [
            np.cos(view["pitch"]) * np.cos(view["yaw"]),
            np.cos(view["pitch"]) * np.sin(view["yaw"]),
            np.sin(view["pitch"]),
        ]
    )
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    away = (tips - view["middle"]) @ forward + 3 * view["size"]
    flat = np.stack(
        [(tips - view["middle"]) @ right, -(tips - view["middle"]) @ np.cross(right, forward)]
    )
    wanted = (flat / away).T
    scale = spread(seen) / spread(wanted)
    off = seen - seen.mean(axis=0) - scale * (wanted - wanted.mean(axis=0))

    assert np.abs(off).max() < 0.5


@pytest.mark.whole
@pytest.mark.parametrize("scheme", ["dark", pytest.param("light", marks=pytest.mark.slow)])
def test_axe_finds_nothing_in_the_scene(opened, scheme):
    """Roles, names and contrast pass with a pose picked."""
    page = opened(scheme=scheme)
    page.locator("select[name=pose]").select_option("Pose 3")
    page.evaluate(AXE)
    found = page.evaluate("axe.run('#cell', {exclude: [['svg']]})")

    assert [f"{v['id']}: {v['nodes'][0]['html'][:120]}" for v in found["violations"]] == []
    assert len(found["passes"]) > 5


@pytest.mark.slow
def test_dark_has_colours_of_its_own(opened, whole):
    """Every colour of the scene and of the map of causes changes with the scheme and stands out."""
    shades = {}
    for scheme in ("light", "dark"):
        page = opened(scheme=scheme, html=whole)
        page.locator("select[name=pose]").select_option("Pose 3")
        shades[scheme] = page.evaluate(
            """() => [".live .base", ".arm.chosen", ".live .fixed", "#figure-separability rect"]
               .map((name) => getComputedStyle(document.querySelector(name)).fill)
               .map((c) => c.match(/\\d+/g).slice(0, 3).reduce((a, b) => a + +b, 0) / 765)"""
        )

    assert all(a != b for a, b in zip(shades["light"], shades["dark"], strict=True))
    assert shades["light"][3] < 0.3 < 0.5 < shades["dark"][3]  # alike: strong on either paper


@pytest.mark.slow
def test_motion_is_left_out_where_it_is_not_wanted(opened):
    """With reduced motion a view is there at once; else it is reached within half a second."""
    quiet, moving = opened(motion="reduce"), opened(motion="no-preference")
    for page in (quiet, moving):
        page.locator("button[data-do=above]").click()
    at_once = dots(quiet)
    quiet.wait_for_timeout(600)
    moving.wait_for_timeout(600)

    assert np.array_equal(at_once, dots(quiet))
    assert np.abs(dots(moving) - at_once).max() < 0.2


@pytest.mark.whole
def test_without_scripts_there_is_a_still(opened):
    """The picture, its words and its table are there where scripts are off; no dead button is."""
    page = opened(java_script_enabled=False)

    assert page.locator(".stage svg").is_visible()
    assert page.locator(".stage [role=img]").get_attribute("aria-label").startswith("Picture of")
    assert page.locator("#table-poses tbody tr").count() == 16
    assert not page.locator(".tools").is_visible()


@pytest.mark.slow
def test_every_label_can_be_read_at_every_width(opened, whole):
    """No letter of any figure is below 8 px from 360 to 2560 px, and nothing leaves the window."""
    page = opened(html=whole)
    small, outside = {}, {}
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        page.evaluate(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        sizes = page.evaluate(
            """() => [...document.querySelectorAll("figure svg text")]
                .filter((one) => one.textContent.trim() && one.getBoundingClientRect().width)
                .map((one) => {
                    const m = one.getScreenCTM();
                    return [one.closest("figure").id,
                            parseFloat(getComputedStyle(one).fontSize) * Math.hypot(m.a, m.b)];
                })"""
        )
        assert len(sizes) > 150
        small |= {(width, name): size for name, size in sizes if size < 8 - 1e-6}
        outside[width] = page.evaluate(
            """() => [...document.querySelectorAll("body *")].filter((one) => {
                const inside = one.closest(".scroll, .skip, svg");
                if (inside && !one.matches(".scroll, svg.live")) return false;
                const box = one.getBoundingClientRect();
                return box.width && (box.right > innerWidth + 0.5 || box.left < -0.5);
            }).map((one) => one.outerHTML.slice(0, 80))"""
        )

    assert small == {}
    assert {width: found for width, found in outside.items() if found} == {}


@pytest.mark.slow
def test_wide_pages_are_used(opened, whole):
    """From 1600 px figures stand beside each other; on a telephone one below the other."""
    page = opened(1600, html=whole)
    columns = {}
    for width in (360, 1600, 2560):
        page.set_viewport_size({"width": width, "height": 900})
        lefts = page.evaluate(
            """() => [...document.querySelectorAll("#residuals figure")]
                .map((one) => Math.round(one.getBoundingClientRect().left))"""
        )
        columns[width] = len(set(lefts))

    assert columns[360] == 1
    assert columns[1600] == 2
    assert columns[2560] >= 3
