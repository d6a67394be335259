"""The certificate of a report as the picture of the README: `make example`."""

import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

from tests.get_browser import browser_path

SIZE = {"width": 1280, "height": 1060}


def shoot(page: Path, picture: Path) -> None:
    """Save what a browser shows of a page without scrolling, in its light colours."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=browser_path())
        sheet = browser.new_page(viewport=SIZE, color_scheme="light")
        sheet.goto(page.resolve().as_uri())
        sheet.screenshot(path=picture)
        browser.close()


if __name__ == "__main__":
    shoot(Path(sys.argv[1]), Path(sys.argv[2]))
