"""Several campaigns of one robot in a project folder, as after a year of use."""

from __future__ import annotations

import json
import os
import re
import shutil
from urllib.parse import unquote

import pytest
import report_sample
from conftest import without_drawings
from pdf_text import pages_of

from pipeline.answer.archive import _SHOWN, read
from pipeline.app.cli import _exit_code
from pipeline.app.shell import run_all
from pipeline.base.errors import UsageError
from pipeline.fleet import history, pages
from pipeline.fleet.states import states
from pipeline.library.preferences import Preferences, Service
from pipeline.report.figures.catalogue import _PLOTS
from pipeline.run import run
from pipeline.service.guard import Guard
from pipeline.service.watch import Clock, scan
from pipeline.simulate import simulate
from pipeline.store.campaign import CampaignFolder, find

DAYS = {"spring": "2026-03-01", "autumn": "2026-09-01"}


def raw(root, name, day, campaign):
    """A campaign's folder, dated."""
    folder = root / "data" / "raw" / name
    folder.mkdir(parents=True)
    for file, content in campaign.files.items():
        if file == "campaign.toml":
            said = f'date = {day}\n\n[robot_unit]\nserial = "4711"\n\n[tracker]'
            content = content.replace(b"[tracker]", said.encode(), 1)
        (folder / file).write_bytes(content)


def contents(root):
    """Bytes of everything under reports, except for the stated run time."""
    found = {}
    for path in sorted((root / "reports").rglob("*")):
        if path.is_file() and path.suffix != ".pdf":
            text = path.read_bytes()
            start = text.find(b'<span id="run-time">')
            end = text.find(b"</span>", start)
            found[path.relative_to(root).as_posix()] = (
                text[:start] + text[end:] if start > 0 else text
            )
    return found


@pytest.fixture(scope="module", autouse=True)
def undrawn():
    """No test here needs figures."""
    with without_drawings():
        yield


@pytest.fixture(scope="module")
def project(tmp_path_factory, small_plan):
    """Two finished campaigns of one robot, half a year apart."""
    root = tmp_path_factory.mktemp("project")
    for later, (name, day) in enumerate(DAYS.items()):
        plan = small_plan.model_copy(update={"seed": small_plan.seed + later})
        raw(root, name, day, simulate(plan))
    assert [o.exit_code for o in run_all(root, [], "local", force=False)] == [0, 0]
    return root


@pytest.mark.whole
@pytest.mark.xdist_group("archive")
def test_every_run_brings_the_page_over_all_campaigns_up_to_date(project):
    """After a run there is a page with links to the page of each campaign."""
    page = (project / "reports" / "index.html").read_text("utf-8")

    for name, day in DAYS.items():
        assert f'href="{name}/index.html"' in page
        assert (project / "reports" / name / "index.html").is_file()
        assert day in page
    assert ">kr500_rail (simulated), serial number 4711</h2>" in page
    assert read(find(project, "spring")).robot_unit.serial == "4711"


@pytest.mark.whole
@pytest.mark.xdist_group("archive")
def test_the_later_report_says_what_changed_since_the_earlier_one(project):
    """The later campaign has the column; the earlier one has no predecessor to compare with."""
    pages = {name: (project / "reports" / name / "index.html").read_text("utf-8") for name in DAYS}

    assert "Change since spring [%]" in pages["autumn"]
    assert "Change since" not in pages["spring"]


@pytest.mark.whole
@pytest.mark.xdist_group("archive")
def test_the_campaign_before_is_found_without_reading_all(project, tmp_path, monkeypatch):
    """Of one machine with ten earlier days, and another of its type, only one answer is read."""
    root = shutil.copytree(project, tmp_path / "year")
    spring, autumn = (find(root, name) for name in ("spring", "autumn"))
    noted = json.loads((spring.processed / "manifest.json").read_text())
    others = {f"day{k}": {"measured": f"2025-01-{k + 10}"} for k in range(10)}
    others["neighbour"] = {"measured": "2026-05-01", "machine": "kr500_rail, serial number 4712"}
    for name, said in others.items():
        folder = shutil.copytree(spring.reports, root / "reports" / name)
        result = json.loads((folder / "result.json").read_text())
        measured = {"campaign": name, "measured": said["measured"]}
        (folder / "result.json").write_text(json.dumps(result | measured))
        kept = root / "data" / "processed" / name
        kept.mkdir()
        source = {"source": f"data/raw/{name}"}
        (kept / "manifest.json").write_text(json.dumps(noted | source | said))
    asked = []
    monkeypatch.setattr(history, "read", lambda one: asked.append(one.name) or read(one))

    before = history.earlier(autumn, read(autumn))

    assert before is not None
    assert before.campaign == "spring"
    assert asked == ["spring"]


def leads(page):
    """Targets of the links of a page, except the page itself."""
    found = re.findall(r'href="([^"#][^"]*)"', page.read_text("utf-8"))
    return {unquote(link) for link in found if not link.startswith("data:")}


@pytest.mark.whole
@pytest.mark.xdist_group("archive")
def test_every_link_leads_to_a_file(project):
    """To PDF, tables and models of a page, to all campaigns and to the previous one."""
    own = {"report.pdf", "result.json", "results.xlsx", "../index.html"}
    own |= {f"model.{ending}" for ending in ("toml", "urdf", "xml", "sdf")}
    reports = project / "reports"

    assert leads(reports / "spring" / "index.html") == own
    assert leads(reports / "autumn" / "index.html") == own | {"../spring/index.html"}
    for page in reports.rglob("index.html"):
        for link in leads(page):
            assert (page.parent / link).is_file(), (page, link)


@pytest.mark.whole
@pytest.mark.slow
@pytest.mark.xdist_group("archive")
def test_no_link_leads_to_what_is_gone_or_was_never_written(project, tmp_path):
    """The previous campaign is deleted, and this one was run by a version without a workbook."""
    shutil.copytree(project, tmp_path / "copy")
    found = find(tmp_path / "copy", "autumn")
    manifest = found.manifest()
    for name in ("results.xlsx", "model.sdf"):
        (found.reports / name).unlink()
        del manifest["outputs"][f"reports/autumn/{name}"]
    (found.processed / "manifest.json").write_text(json.dumps(manifest), "utf-8")
    shutil.rmtree(tmp_path / "copy" / "reports" / "spring")

    pages.refresh(tmp_path / "copy")

    page = found.reports / "index.html"
    there = {path.relative_to(found.reports).as_posix() for path in found.reports.glob("*.*")}
    assert leads(page) == (there - {"index.html"}) | {"../index.html"}
    assert "results.xlsx" not in leads(page)


@pytest.mark.whole
@pytest.mark.xdist_group("archive")
def test_nothing_is_written_a_second_time(project):
    """A second run finds everything up to date and touches no file; all campaigns count as done."""
    before = {p: p.stat().st_mtime_ns for p in (project / "reports").rglob("*") if p.is_file()}

    list(run_all(project, [], "local", force=False))

    assert {p: p.stat().st_mtime_ns for p in before} == before
    assert [outcome.content["state"] for outcome in states(project)] == ["done", "done"]


@pytest.mark.whole
@pytest.mark.slow
@pytest.mark.xdist_group("archive")
def test_a_report_is_drawn_once(project, tmp_path):
    """The run itself knows the previous campaign, so that nothing is drawn again."""
    shutil.copytree(project, tmp_path / "copy")

    run(find(tmp_path / "copy", "autumn"), force=True)

    page = (tmp_path / "copy" / "reports" / "autumn" / "index.html").read_text("utf-8")
    assert "Change since spring [%]" in page


@pytest.mark.whole
@pytest.mark.slow
@pytest.mark.xdist_group("archive")
def test_the_order_of_the_runs_does_not_matter(project, tmp_path):
    """A late campaign is still the predecessor of those measured after it."""
    shutil.copytree(project / "data" / "raw" / "autumn", tmp_path / "data" / "raw" / "autumn")
    list(run_all(tmp_path, [], "local", force=False))
    alone = (tmp_path / "reports" / "autumn" / "index.html").read_text("utf-8")
    shutil.copytree(project / "data" / "raw" / "spring", tmp_path / "data" / "raw" / "spring")

    list(run_all(tmp_path, ["spring"], "local", force=False))

    assert "Change since" not in alone
    assert contents(tmp_path) == contents(project)


@pytest.mark.whole
@pytest.mark.slow
@pytest.mark.xdist_group("archive")
def test_a_campaign_run_by_path_is_told_too(project, tmp_path, small_plan):
    """A folder outside data/raw is in the archive, with its predecessor."""
    shutil.copytree(project, tmp_path / "copy")
    elsewhere = tmp_path / "stick"
    raw(elsewhere, "winter", "2026-12-01", simulate(small_plan))
    folder = str(elsewhere / "data" / "raw" / "winter")

    done = list(run_all(tmp_path / "copy", [folder], "local", force=False))

    reports = tmp_path / "copy" / "reports"
    assert [outcome.exit_code for outcome in done] == [0]
    assert "Change since autumn [%]" in (reports / "winter" / "index.html").read_text("utf-8")
    assert 'href="winter/index.html"' in (reports / "index.html").read_text("utf-8")


@pytest.mark.whole
@pytest.mark.slow
@pytest.mark.xdist_group("archive")
def test_a_campaign_that_arrives_by_itself_joins_the_page(project, tmp_path, small_plan):
    """Campaigns run by `watch` and `serve` are on the page over all campaigns, too."""
    shutil.copytree(project, tmp_path / "copy")
    raw(tmp_path / "copy", "winter", "2026-12-01", simulate(small_plan))

    at_once = Clock(pause=lambda _: None)
    with Guard(tmp_path / "copy", "local", Service()) as work:
        found = [o.campaign for o in scan(tmp_path / "copy", Preferences(), work, at_once)]

    page = (tmp_path / "copy" / "reports" / "index.html").read_text("utf-8")
    assert "winter" in found
    assert 'href="winter/index.html"' in page


@pytest.mark.whole
@pytest.mark.slow
@pytest.mark.xdist_group("archive")
def test_a_run_that_is_going_on_is_left_out(project, tmp_path):
    """Without its manifest a result does not count: the page over all omits it."""
    shutil.copytree(project, tmp_path / "copy")
    (tmp_path / "copy" / "data" / "processed" / "spring" / "manifest.json").unlink()

    page = pages.refresh(tmp_path / "copy")

    assert "spring/index.html" not in page.read_text("utf-8")
    assert "Change since" not in (page.parent / "autumn" / "index.html").read_text("utf-8")


def first_version(verdict):
    """result.json of the first version: the values of the joint springs only."""
    content = report_sample.answer().as_json()
    for name in ("recommended", "joint_springs", "extended"):
        del content[name]
    for joint in content["stiffness"]:
        del joint["joint_name"], joint["remarks"]
    content["diagnosis"]["verdict"] = verdict
    return content | {"key_of_its_own": 1}


def kept(root, name, text):
    """A campaign under `root` whose last run left this result.json."""
    folder = root / "reports" / name
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(text)
    return CampaignFolder(root, root / "data" / "raw" / name)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text[:-9],
        lambda text: text.replace('"dof"', '"dog"'),
        lambda text: text.replace('"k_theta2"', "null"),
        lambda text: "[]",
        lambda text: "null",
        lambda text: "{}",
    ],
)
def test_a_result_that_lacks_what_is_needed_is_refused_in_a_sentence(tmp_path, spoil):
    """Truncated, with a missing key, with an invalid null, or no result at all."""
    campaign = kept(tmp_path, "odd", spoil(json.dumps(report_sample.answer().as_json())))

    with pytest.raises(UsageError, match="odd has a result of an earlier version: run `pipeline"):
        read(campaign)


@pytest.mark.whole
@pytest.mark.slow
@pytest.mark.xdist_group("archive")
def test_a_result_that_cannot_be_read_is_left_out_and_said(project, tmp_path, capsys):
    """The others are used as if it did not exist."""
    shutil.copytree(project, tmp_path / "copy")
    result = tmp_path / "copy" / "reports" / "spring" / "result.json"
    result.write_text(result.read_text().replace('"equilibrium"', '"equilibria"'))

    page = pages.refresh(tmp_path / "copy")

    assert [one.campaign.name for one in history.finished(tmp_path / "copy")] == ["autumn"]
    assert "spring/index.html" not in page.read_text("utf-8")
    assert "Change since" not in (page.parent / "autumn" / "index.html").read_text("utf-8")
    assert capsys.readouterr().err.splitlines() == [
        "spring has a result of an earlier version: run `pipeline run spring` first. Until then "
        "it is left out of the page over all campaigns."
    ]


@pytest.mark.whole
@pytest.mark.xdist_group("archive")
def test_report_gives_every_form(project, capsys):
    """`pipeline report` prints the path of page, PDF or data, or the report itself as text."""
    for form, file in (("html", "index.html"), ("pdf", "report.pdf"), ("json", "result.json")):
        assert _exit_code(["report", "spring", "--format", form, "--root", str(project)]) == 0
        assert capsys.readouterr().out.strip() == str(project / "reports" / "spring" / file)

    assert _exit_code(["report", "autumn", "--format", "text", "--root", str(project)]) == 0
    text = capsys.readouterr().out
    assert text.startswith("Joint stiffness of kr500_rail: autumn\n====")
    assert "Change since spring [%]" in text
    assert _exit_code(["report", "--root", str(project)]) == 0
    assert capsys.readouterr().out.strip() == str(project / "reports" / "index.html")


@pytest.mark.whole
@pytest.mark.xdist_group("archive")
@pytest.mark.parametrize(("form", "file"), [("html", "index.html"), ("pdf", "report.pdf")])
def test_a_further_certificate_lies_beside_the_report(project, form, file, capsys):
    """In German, in its own folder; the report in English is unchanged."""
    before = (project / "reports" / "spring" / file).read_bytes()
    words = ["report", "spring", "--language", "de", "--format", form, "--root", str(project)]

    assert _exit_code(words) == 0
    made = project / "reports" / "spring" / "de" / file
    assert capsys.readouterr().out.strip() == str(made)
    content = made.read_bytes()
    told = content.decode() if form == "html" else "".join(pages_of(content)[:2])
    told = " ".join(told.split())
    assert "Steifigkeit ± U" in told
    assert "Was zu tun ist" in told
    assert (project / "reports" / "spring" / file).read_bytes() == before


@pytest.mark.whole
@pytest.mark.xdist_group("archive")
def test_compare_says_how_two_campaigns_differ(project, capsys):
    """As text, data and page; the data are those of the two results."""
    assert _exit_code(["compare", "spring", "autumn", "--json", "--root", str(project)]) == 0
    told = json.loads(capsys.readouterr().out)
    results = {n: json.loads((project / "reports" / n / "result.json").read_bytes()) for n in DAYS}
    first = results["spring"]["stiffness"][1], results["autumn"]["stiffness"][1]

    assert told["stiffness"][1]["name"] == "k_theta2"
    assert told["stiffness"][1]["percent"] == pytest.approx(
        100 * (first[1]["value"] / first[0]["value"] - 1)
    )
    assert 0 <= told["p_value"] <= 1
    assert told["dof"] == sum(s["identifiable"] for s in results["spring"]["stiffness"])
    assert "spring beside autumn" in (project / "reports" / "spring--autumn.html").read_text(
        "utf-8"
    )
    assert _exit_code(["compare", "spring", "autumn", "--root", str(project)]) == 0
    assert "Change [%]" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["compare", "spring", "spring:best"],
            'no model "best": use recommended, joints, extended',
        ),
        (["compare", "spring", "spring:extended"], "no richer model than its joint springs"),
        (["report", "spring", "--format", "odt"], 'no format "odt"'),
        (["report", "--language", "de"], "no further language: name a campaign"),
        (["report", "--format", "pdf"], "no form pdf: name a campaign"),
        (["report", "--format", "pdf"], "name a campaign"),
        (["report", "--format", "text"], "name the campaign"),
        (["report", "spring", "--format", "text", "--language", "de"], "text is in English alone"),
        (["report", "spring", "--format", "json", "--language", "fr"], "or ask for pdf"),
    ],
)
@pytest.mark.whole
@pytest.mark.xdist_group("archive")
def test_what_cannot_be_done_is_said(project, capsys, words, said):
    """A wrong word gives one sentence and exit code 2."""
    assert _exit_code([*words, "--root", str(project)]) == 2
    assert said in capsys.readouterr().err


def test_a_project_without_results_has_no_page(tmp_path, capsys):
    """Before the first run there is nothing to show, which is reported."""
    assert pages.refresh(tmp_path) is None
    assert _exit_code(["report", "--root", str(tmp_path)]) == 2
    assert "no campaign is finished" in capsys.readouterr().err


@pytest.mark.parametrize("lost", ["data/processed/c/manifest.json", "reports/c/index.html"])
def test_a_pipe_in_place_of_a_result_is_no_result(tmp_path, lost):
    """A pipe without a writer: `status` does not wait, and the campaign counts as new."""
    campaign = CampaignFolder(tmp_path, tmp_path / "data" / "raw" / "c")
    campaign.folder.mkdir(parents=True)
    campaign.finish("key", {"result.json": b"{}", "index.html": b"page"}, {})
    assert campaign.done("key")
    (tmp_path / lost).unlink()
    os.mkfifo(tmp_path / lost)

    assert not campaign.done("key")


def test_a_day_that_no_calendar_has_leaves_one_campaign_out(tmp_path):
    """A result of an earlier version may have the year 0: it is named, and the others are used."""
    for name, day in (("a", "2026-03-01"), ("b", "0000-11-03T08:00:08")):
        campaign = CampaignFolder(tmp_path, tmp_path / "data" / "raw" / name)
        content = report_sample.answer().as_json() | {"campaign": name, "measured": day}
        campaign.finish("key", {"result.json": json.dumps(content).encode()}, {})
    said = []

    assert [one.campaign.name for one in history.finished(tmp_path, said.append)] == ["a"]
    assert said[0].startswith("b has a result of an earlier version")


@pytest.mark.whole
@pytest.mark.slow
def test_wear_is_said_by_the_newest_report_and_on_the_terminal(project, tmp_path, capsys):
    """In one sentence each; the page over all campaigns begins with it, and nothing is redrawn."""
    root = shutil.copytree(project, tmp_path / "copy")
    path = root / "reports" / "autumn" / "result.json"
    content = json.loads(path.read_bytes())
    for joint in content["stiffness"]:
        softer = 1.5 if joint["joint"] == 3 else 1.0
        joint["compliance"] *= softer
        joint["value"] /= softer
    path.write_text(json.dumps(content), "utf-8")
    manifest = root / "data" / "processed" / "autumn" / "manifest.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"key": "softer"}), "utf-8")

    page = pages.refresh(root)
    said = capsys.readouterr().err
    written = contents(root)

    assert re.fullmatch(r"kr500_rail.*, serial number 4711: A2 \(k_theta3\).* softer by .*\n", said)
    assert " softer by" in page.read_text("utf-8")
    assert "inspect A2" in page.read_text("utf-8")
    newest, earlier = (
        (root / "reports" / name / "index.html").read_text("utf-8") for name in ("autumn", "spring")
    )
    assert " softer by" in newest
    assert " softer by" not in earlier
    pages.refresh(root)
    assert capsys.readouterr().err == ""
    assert contents(root) == written


def test_every_table_that_a_figure_needs_is_read_back():
    """A report rebuilt from disk has the figures of the first one."""
    assert {name for plot in _PLOTS.values() for name in plot.needs} <= set(_SHOWN)
