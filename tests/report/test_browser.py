"""The page in a real browser: what only shows once it is laid out, coloured and pressed on."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from importlib.resources import files as package_files

import pytest
import report_sample
from get_browser import browser_path
from pdf_text import pages_of

from pipeline.fleet.overview import render_overview
from pipeline.report.model import compose
from pipeline.report.render import render

# the sample is drawn once for all
pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("report")]


AXE = package_files("axe_playwright_python").joinpath("axe.min.js").read_text("utf-8")


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    """Headless Chromium, or a skip that says how to get it."""
    path = browser_path()
    if path is None:
        pytest.skip("no browser: install chromium (`apt-get install chromium`) or set BROWSER_PATH")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path)
        yield running
        running.close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A report on disk, as a user opens it."""
    folder = tmp_path_factory.mktemp("report")
    made = report_sample.rendered()
    (folder / "index.html").write_bytes(made["index.html"])
    return (folder / "index.html").as_uri()


@pytest.fixture
def opened(browser, address):
    """Opens the report; console messages, failures and requests are judged at the end."""
    contexts, wrong, sample = [], [], address

    def open_page(width: int = 1280, scheme: str = "light", address: str = sample):
        context = browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme, reduced_motion="reduce"
        )
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda said: wrong.append(f"console {said.type}: {said.text}"))
        page.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        page.on(
            "request",
            lambda asked: asked.url in (address, "data:,") or wrong.append(f"asked {asked.url}"),
        )
        page.goto(address)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert wrong == []


def words(text: str) -> str:
    """Text without white space, which a line end changes, and without ligatures."""
    return re.sub(r"[\s\u200b\u00ad]", "", unicodedata.normalize("NFKC", text))


def texts(page, selector: str) -> list[str]:
    """Text of all elements of a selector."""
    return page.locator(selector).all_inner_texts()


def test_the_page_opens_without_error_and_asks_for_nothing(opened):
    """No console message, no script error, no request beside the file itself."""
    page = opened()

    assert page.title() == "Joint stiffness of kr500_rail: kr500-sample"
    said = compose(report_sample.answer(), report_sample.tables())
    assert page.locator("svg").count() == len(said.figures)


@pytest.mark.parametrize("width", [360, 768, 1920])
def test_nothing_overflows(opened, width):
    """The page never scrolls sideways, and nothing but a scroll region reaches out of it."""
    page = opened(width)

    outside = page.evaluate(
        """() => [...document.querySelectorAll("body *")].filter((element) => {
            if (element.closest(".scroll, .skip") && !element.matches(".scroll")) return false;
            const box = element.getBoundingClientRect();
            return box.width && (box.right > innerWidth + 0.5 || box.left < -0.5);
        }).map((element) => element.outerHTML.slice(0, 120))"""
    )

    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert outside == []


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("width", "scheme"), [(360, "dark"), (1920, "light")])
def test_the_page_over_all_campaigns_is_as_good(opened, tmp_path, width, scheme):
    """The overview passes axe-core, does not overflow, and its history can be read by keyboard."""
    answers = [
        report_sample.answer().model_copy(update={"campaign": f"c{k}", "measured": f"202{k}-01-01"})
        for k in range(4)
    ]
    (tmp_path / "index.html").write_bytes(render_overview(answers))
    page = opened(width, scheme, address=(tmp_path / "index.html").as_uri())
    page.evaluate(AXE)

    assert page.evaluate("axe.run({exclude: [['svg']]})")["violations"] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.locator(".plot").focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("#tip").inner_text().startswith("c0: k_r1 77.92")


@pytest.mark.whole
@pytest.mark.parametrize("width", [1440, 2560])
def test_on_a_screen_no_table_or_figure_is_cut_off(opened, width):
    """Where there is room beside it, nothing stands in a part of the page that is too narrow."""
    page = opened(width)
    cut = page.evaluate(
        """() => [...document.querySelectorAll(".scroll")]
            .filter((frame) => frame.scrollWidth > frame.clientWidth + 1)
            .map((frame) => frame.parentElement.id)"""
    )

    assert page.locator("#table-blind-spots-never").count() == 1
    assert cut == []


@pytest.mark.whole
def test_no_word_of_a_figure_is_cut(opened):
    """Every label of a figure stands inside it, but for the empty edge of its letters' boxes."""
    page = opened(1920)
    cut = page.evaluate(
        """() => [...document.querySelectorAll("svg")].flatMap((figure) => {
            const sheet = figure.getBoundingClientRect();
            return [...figure.querySelectorAll("text")].filter((text) => {
                const box = text.getBoundingClientRect();
                return box.left < sheet.left - 3 || box.right > sheet.right + 3
                    || box.top < sheet.top - 3 || box.bottom > sheet.bottom + 3;
            }).map((text) => text.textContent);
        })"""
    )

    assert page.locator("svg text").count() > 150
    assert cut == []


@pytest.mark.whole
def test_what_is_cut_off_can_be_scrolled_to(opened):
    """On a telephone a wide table scrolls within its own frame, by keyboard too."""
    page = opened(360)
    frame = page.locator("#table-stiffness .scroll")
    frame.focus()
    page.keyboard.press("ArrowRight")
    for _ in range(100):  # the page forbids to evaluate strings, which waiting for one would do
        if frame.evaluate("one => one.scrollLeft") > 0:
            break
        page.wait_for_timeout(50)
    assert frame.evaluate("one => one.scrollLeft") > 0


@pytest.mark.whole
@pytest.mark.parametrize(("width", "scheme"), [(1280, "dark"), (360, "light")])
def test_axe_finds_nothing(opened, width, scheme):
    """Contrast, names, roles and structure pass axe-core in light and in dark."""
    page = opened(width, scheme)
    page.evaluate(AXE)

    found = page.evaluate("axe.run({exclude: [['svg']]})")
    complaints = [
        f"{v['id']}: {v['nodes'][0]['html'][:120]} {v['nodes'][0]['failureSummary']}"
        for v in found["violations"]
    ]

    assert complaints == []
    assert "color-contrast" in {passed["id"] for passed in found["passes"]}


@pytest.mark.whole
def test_dark_is_dark_and_figures_follow(opened):
    """In the dark scheme the paper is dark and the figures' lines are light."""
    shades = {}
    for scheme in ("light", "dark"):
        page = opened(scheme=scheme)
        shades[scheme] = page.evaluate(
            """() => [getComputedStyle(document.body).backgroundColor,
                      getComputedStyle(document.querySelector("#figure-pose-rms text")).fill]
               .map((c) => c.match(/\\d+/g).slice(0, 3).reduce((a, b) => a + +b, 0) / 765)"""
        )

    paper, ink = zip(shades["light"], shades["dark"], strict=True)
    assert paper[0] > 0.9 > 0.2 > paper[1]
    assert ink[0] < 0.2 < 0.8 < ink[1]


def test_a_press_on_a_heading_sorts_by_number(opened):
    """Numbers sort as numbers, not as words; a second press turns them round; blanks stay last."""
    page = opened()
    heading = page.locator("#table-stiffness th", has_text="Stiffness ±")
    first = "#table-stiffness tbody tr td:first-child"

    heading.locator("button").click()
    up = texts(page, first)
    assert heading.get_attribute("aria-sort") == "ascending"
    heading.locator("button").click()
    down = texts(page, first)
    assert heading.get_attribute("aria-sort") == "descending"

    order = ["k_theta5", "k_theta6", "k_theta2", "k_theta4", "k_theta3", "k_r1"]
    assert up == [*order, "k_theta7"]
    assert down == [*order[::-1], "k_theta7"]


@pytest.mark.whole
def test_tables_sort_by_keyboard(opened):
    """A heading can be reached and pressed without a mouse."""
    page = opened()
    page.locator("#table-inputs th button").first.focus()
    page.keyboard.press("Enter")

    assert texts(page, "#table-inputs tbody td:first-child") == ["campaign.toml", "tracker.csv"]


def test_a_value_shows_under_the_pointer_and_goes_away(opened):
    """Resting on a bar shows the pose and its rms, leaving hides it."""
    page = opened()
    bar = page.locator("#figure-pose-rms [data-tip^='pose 5:']")
    bar.scroll_into_view_if_needed()
    bar.hover()
    tip = page.locator("#tip")

    assert tip.is_visible()
    assert tip.inner_text() == bar.get_attribute("data-tip")
    page.mouse.move(2, 2)
    assert tip.is_hidden()


@pytest.mark.whole
def test_arrow_keys_walk_through_the_values(opened):
    """Who has no pointer reads the values one by one; the tip stays inside the window."""
    page = opened(360)
    page.locator("#figure-stiffness .plot").focus()
    said = []
    for _ in range(2):
        page.keyboard.press("ArrowRight")
        said.append(page.locator("#tip").inner_text())
    box = page.locator("#tip").bounding_box()

    assert said[0].startswith("k_r1: 97.4 %")
    assert said[1].startswith("k_theta2: 98.7 %")
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 360


@pytest.mark.whole
def test_a_value_stays_beside_its_mark_while_the_page_scrolls(opened):
    """A browser may scroll a figure into view after the first arrow key: the value goes along."""
    page = opened(360)
    page.locator("#figure-stiffness .plot").focus()
    page.keyboard.press("ArrowRight")
    mark, tip = page.locator(".seen"), page.locator("#tip")
    gap = tip.bounding_box()["y"] - mark.bounding_box()["y"]
    page.evaluate("""new Promise(done => {
        addEventListener("scroll", () => requestAnimationFrame(done), { once: true });
        scrollBy(0, 40);
    })""")

    assert tip.is_visible()
    assert abs(tip.bounding_box()["y"] - mark.bounding_box()["y"] - gap) < 1.0


@pytest.mark.whole
def test_a_smuggled_script_does_not_run(browser, tmp_path):
    """Even markup that got past the escaping could not run: the page allows its own script only."""
    answer = report_sample.answer().model_copy(update={"campaign": "SMUGGLED"})
    made = render(answer, {})["index.html"].decode()
    smuggled = "<script>window.ran = 1</script><img src=x onerror='ran=1'>"
    spoilt = made.replace("<h1>SMUGGLED", f"<h1>{smuggled}")
    assert spoilt != made
    (tmp_path / "index.html").write_text(spoilt, "utf-8")
    page = browser.new_page()
    page.goto((tmp_path / "index.html").as_uri())

    assert page.evaluate("window.ran") is None
    page.close()


@pytest.mark.whole
def test_it_prints_without_cutting_a_figure(opened, tmp_path):
    """On paper every figure stands whole on one page and no control is printed."""
    page = opened()
    page.pdf(path=tmp_path / "print.pdf", format="A4")
    pages = [words(text) for text in pages_of((tmp_path / "print.pdf").read_bytes())]
    joined = "".join(pages)

    assert 3 <= len(pages) <= 20
    assert "Skiptothereport" not in joined
    assert "↕" not in joined
    for figure in compose(report_sample.answer(), report_sample.tables()).figures:
        if figure.name == "gauge":  # its words are in it
            continue
        start, end = words(figure.title), words(figure.caption)[-40:]
        assert any(start in text and end in text for text in pages), figure.name
