"""The documentation site: built without network, warnings or broken links."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import pipeline

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"

pytestmark = pytest.mark.timeout(2400)  # the tutorials take a minute of processor time


class Page(HTMLParser):
    """Anchors of a page, and targets of its links and resources."""

    def __init__(self, path):
        super().__init__()
        self.ids, self.links, self.loads = set(), set(), set()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attrs):
        """Record anchors, links and resources of a tag."""
        told = dict(attrs)
        self.ids |= {told[key] for key in ("id", "name") if told.get(key)}
        if tag == "a" and told.get("href"):
            self.links.add(told["href"])
        elif tag in ("script", "img", "link", "iframe"):
            self.loads |= {told[key] for key in ("src", "href") if told.get(key)}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Every page, built as by `make docs`; the tutorials are executed."""
    pytest.importorskip("myst_nb", reason="make docs installs what builds the site")
    out = tmp_path_factory.mktemp("site")
    words = ["-q", "-W", "--keep-going", "-b", "html", "-d", str(out / "doctrees")]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *words, str(DOCS), str(out / "html")],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return {path.relative_to(out / "html").as_posix(): Page(path) for path in
            (out / "html").rglob("*.html")}, out / "html"  # fmt: skip


@pytest.mark.slow
def test_every_page_is_on_the_site_and_loads_nothing_from_elsewhere(site):
    """Each Markdown file of docs/ is a page; scripts, styles and figures are on the site."""
    pages, _ = site
    sources = {path.relative_to(DOCS).with_suffix(".html").as_posix()
               for path in DOCS.rglob("*.md")}  # fmt: skip

    assert sources <= set(pages)
    for name, page in pages.items():
        assert not [one for one in page.loads if "//" in one], name


@pytest.mark.slow
def test_every_link_within_the_site_leads_somewhere(site):
    """The file exists, and the anchor in it."""
    pages, folder = site
    for name, page in pages.items():
        for link in page.links:
            if re.match(r"[a-z]+:", link):
                continue
            path, _, place = link.partition("#")
            target = (folder / name).parent / path if path else folder / name
            assert target.exists(), (name, link)
            inner = target.resolve().relative_to(folder.resolve()).as_posix()
            if place and inner in pages:
                assert place in pages[inner].ids, (name, link)


@pytest.mark.slow
def test_every_public_name_is_on_the_page_of_the_library(site):
    """Everything that `import pipeline` offers is described there, and on no other page."""
    pages, _ = site

    assert {f"pipeline.{name}" for name in pipeline.__all__} <= pages["library.html"].ids


def test_the_site_is_built_beside_the_locked_libraries():
    """Both locks pin the same versions: installing the second changes nothing of the first."""
    locks = [(ROOT / name).read_text("utf-8") for name in ("requirements.lock",
                                                           "docs/requirements.lock")]  # fmt: skip
    ours, site = (dict(re.findall(r"(?m)^([a-z0-9._-]+)==([^ ;\\]+)", lock)) for lock in locks)

    assert {"sphinx", "furo", "myst-nb"} <= set(site)
    assert {name: site[name] for name in site.keys() & ours} == {
        name: ours[name] for name in site.keys() & ours
    }
