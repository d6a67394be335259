"""The pages behind their door: who gets in, what is refused, what is armed when."""

import asyncio
import contextlib
import io
import json
import re
import shutil
import socket
import threading
import time
import tomllib
from pathlib import Path

import httpx
import pytest
import uvicorn
from markupsafe import Markup

from pipeline.app import cli
from pipeline.base.errors import UsageError
from pipeline.page import jobs, server

DEMO = Path(__file__).parents[2] / "data" / "raw" / "kr500_demo"
TOKEN = "a-token"


@pytest.fixture
def outside(tmp_path):
    with socket.socket() as free:
        free.bind((server.HERE, 0))
        port = free.getsockname()[1]
    pages = server.application(tmp_path, port, TOKEN)
    running = uvicorn.Server(uvicorn.Config(pages, port=port, log_level="error"))
    thread = threading.Thread(target=running.run)
    thread.start()
    while not running.started:
        time.sleep(0.02)
    at = f"http://{server.HERE}:{port}"
    with httpx.Client(base_url=at, timeout=120, follow_redirects=True, trust_env=False) as client:
        yield client
    running.should_exit = True
    thread.join(20)


@pytest.fixture
def client(outside):
    assert outside.get(f"/enter?token={TOKEN}").status_code == 200
    return outside


def drop(client, *files, name="hall"):
    client.post("/campaigns", content=json.dumps({"name": name}))
    for file in files:
        said = client.put(f"/c/{name}/file/{file.name}", content=file.read_bytes())
        assert said.json()["problem"] == ""


@pytest.fixture
def demo(client):
    """A whole campaign, as the terminal would have it."""
    drop(
        client, *(DEMO / one for one in ("tracker.csv", "loads.csv", "joints.csv", "campaign.toml"))
    )
    return client


def carried_out(*words):
    """A command in this process; one of its own takes a second of imports and is started above."""
    with io.TextIOWrapper(io.BytesIO(), "utf-8") as out, io.StringIO() as said:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
            code = cli._exit_code([*map(str, words)])
        out.flush()
        output, lines = out.buffer.getvalue(), tuple(said.getvalue().splitlines())
    return jobs.CommandOutput(code, jobs._content(output), output, lines)


@pytest.fixture
def here(monkeypatch):
    """Commands that only read are carried out in this process."""

    async def command(*words):
        return await asyncio.to_thread(carried_out, *words)

    monkeypatch.setattr(server, "command", command)


@pytest.mark.parametrize(
    "way", ["/", "/c/hall/files", "/looks/page.js", "/enter?token=other", "/enter"]
)
def test_nobody_gets_in_without_the_token(outside, way):
    """Not by an address, not by a wrong one."""
    answer = outside.get(way)

    assert answer.status_code == 403
    assert TOKEN not in answer.text


@pytest.mark.parametrize(
    "headers",
    [{"host": "evil.example"}, {"host": "127.0.0.1:1"}, {"origin": "http://evil.example"},
     {"origin": "null"}],
)  # fmt: skip
def test_other_hosts_and_origins_are_turned_away(client, headers):
    """Also with the cookie: a page of somebody else's, or a name that leads here."""
    assert client.get("/", headers=headers).status_code == 403
    assert client.post("/campaigns", content='{"name": "x"}', headers=headers).status_code == 403


def test_the_cookie_is_for_us_alone(outside):
    """No script reads it, no other site sends it."""
    said = (
        outside.get(f"/enter?token={TOKEN}", follow_redirects=False).headers["set-cookie"].lower()
    )

    assert "httponly" in said
    assert "samesite=lax" in said


def test_pages_load_nothing_from_elsewhere(demo):
    """And run no script that stands in their text."""
    for page in ("/", *(f"/c/hall/{one}" for one in ("files", "setup", "check", "run", "answer"))):
        answer = demo.get(page)

        assert answer.status_code == 200, page
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy, page
        assert "unsafe" not in policy, page
        assert "http" not in answer.text.replace("http://www.w3.org/2000/svg", ""), page


HOSTILE = "<script>alert(1)</script>'\"><img src=x onerror=alert(1)>{{7*7}}"


def test_what_a_stranger_writes_is_shown_as_it_is(here, demo):
    """In a file's cells, in campaign.toml, in its comments."""
    text = demo.get("/c/hall/setup").text
    seen = text.partition('data-seen="')[2].partition('"')[0]
    toml = (
        DEMO / "campaign.toml"
    ).read_text() + f"\n[robot_unit]\nserial = {json.dumps(HOSTILE)}   # {HOSTILE}\n"
    assert (
        demo.post("/c/hall/text", content=json.dumps({"text": toml, "seen": seen})).status_code
        == 200
    )
    demo.put("/c/hall/file/odd.csv", content=f"group,{HOSTILE},x,y,z\na,{HOSTILE},1,2,3\n".encode())

    for page in ("/c/hall/setup", "/c/hall/files", "/c/hall/look/odd.csv"):
        body = demo.get(page).text

        assert "<script>alert" not in body
        assert "<img src=x" not in body
        assert "49" not in body.partition("alert(1)")[2][:40]


@pytest.mark.parametrize("name", ["%2e%2e", "..%2f..%2fetc", "a%2fb", ".hidden", "a%00"])
def test_no_name_leads_out_of_the_folder(demo, tmp_path, name):
    """Neither a campaign's, nor a file's, nor one of a report's."""
    before = sorted(tmp_path.rglob("*"))

    for method, way in (
        ("GET", f"/c/{name}/files"),
        ("PUT", f"/c/hall/file/{name}"),
        ("DELETE", f"/c/hall/file/{name}"),
        ("GET", f"/c/hall/report/{name}"),
        ("GET", f"/c/hall/look/{name}"),
        ("GET", f"/looks/{name}"),
    ):
        assert demo.request(method, way).status_code in (400, 404, 405)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.whole
def test_run_is_armed_by_the_check_and_disarmed_by_any_change(demo):
    """A file that is touched after it was checked is another campaign."""
    assert "check first" in demo.post("/c/hall/run").json()["problem"]
    assert "waits for check" in demo.get("/c/hall/check").text
    assert demo.post("/c/hall/check").json()["problem"] == ""
    assert "Accepted as it is now" in demo.get("/c/hall/check").text
    assert "waits for check" not in demo.get("/c/hall/check").text
    assert "disabled" not in demo.get("/c/hall/run").text

    demo.put("/c/hall/file/note.txt", content=b"moved the tracker at noon")

    assert "check again" in demo.get("/c/hall/check").text
    assert "disabled" in demo.get("/c/hall/run").text
    assert "check first" in demo.post("/c/hall/run").json()["problem"]


@pytest.mark.whole
def test_a_wrong_line_is_shown_beside_its_reason(demo, tmp_path):
    """And nothing runs."""
    path = tmp_path / "data" / "raw" / "hall" / "campaign.toml"
    path.write_text(path.read_text().replace("[naming]", "[naming]\nmeasurde = 3"))

    demo.post("/c/hall/check")

    page = demo.get("/c/hall/check").text
    assert "measurde" in page
    assert "Not accepted" in page
    assert demo.post("/c/hall/run").status_code == 400


def until(client, *states, most_s=120):
    end = time.monotonic() + most_s
    while (now := client.get("/c/hall/progress").json())["state"] not in states:
        assert time.monotonic() < end, now
        time.sleep(0.3)
    return now


@pytest.mark.whole
def test_a_run_gives_the_answer_of_the_command(demo, tmp_path):
    """The same result.json; a second Run while it runs is the same run."""
    demo.post("/c/hall/check")
    assert demo.post("/c/hall/run").json()["problem"] == ""
    assert demo.post("/c/hall/run").json()["problem"] == ""
    until(demo, "done")

    found = json.loads((tmp_path / "reports" / "hall" / "result.json").read_text())
    page = demo.get("/c/hall/answer").text
    assert found["diagnosis"]["verdict"] == "adequate"
    for line in found["first_screen"]:  # the stiffnesses are a table
        assert (str(Markup.escape(line["text"])) in page) is (line["about"] != "numbers")
    for one in found["stiffness"]:
        percent = f"{100 * one['relative_std']:.2g} %"
        row = rf'<th scope="row">{one["axis"]}</th>\s*<td [^>]*>[^<]+</td><td [^>]*>{percent}</td>'
        assert re.search(row, page)
    assert "<dt>What to do</dt>" in page
    assert "report/report.pdf" in page
    demo.put("/c/hall/file/note.txt", content=b"moved the tracker at noon")
    assert "of an earlier run" not in page
    demo.put("/c/hall/file/loads.csv?instead=1", content=(DEMO / "loads.csv").read_bytes() + b"\n")
    assert "of an earlier run" in demo.get("/c/hall/answer").text
    report = demo.get("/c/hall/report/index.html")
    assert "sandbox" in report.headers["content-security-policy"]
    assert "allow-same-origin" not in report.headers["content-security-policy"]


def test_an_answer_of_other_types_is_a_sentence(tmp_path):
    """A result.json of somebody else's is no internal error of its page."""
    desk = server.Desk(tmp_path, "hall")
    desk.reports.mkdir(parents=True)
    (desk.reports / "result.json").write_text('{"first_screen": 1}')

    with pytest.raises(UsageError, match="run `pipeline run hall` first"):
        server._State(tmp_path).answer(desk)


@pytest.mark.slow
def test_a_run_that_is_cancelled_leaves_nothing(demo, tmp_path):
    """No report, and the next run begins at once."""
    demo.post("/c/hall/check")
    demo.post("/c/hall/run")
    time.sleep(1.0)
    demo.post("/c/hall/cancel")

    assert until(demo, "cancelled", "done")["state"] == "cancelled"
    assert not (tmp_path / "reports" / "hall" / "result.json").exists()
    assert demo.post("/c/hall/run").json()["problem"] == ""
    until(demo, "done")


def test_from_files_to_fields_and_back(here, client, tmp_path):
    """campaign.toml is written for the files; each field is a line of it; comments stay."""
    drop(client, *(DEMO / one for one in ("tracker.csv", "loads.csv", "joints.csv")))
    assert client.post("/c/hall/init").json()["go"].endswith("/setup")
    page = client.get("/c/hall/setup").text
    seen = page.partition('data-seen="')[2].partition('"')[0]
    path = tmp_path / "data" / "raw" / "hall" / "campaign.toml"
    line = next(
        k for k, one in enumerate(path.read_text().splitlines(), 1) if one.startswith("# P2 = ?")
    )

    typed = {"line": line, "said": ["-120", "190,5", "100"], "unit": "mm", "seen": seen}
    said = client.post("/c/hall/fill", content=json.dumps(typed)).json()

    assert said["problem"] == ""
    assert path.read_text().splitlines()[line - 1] == "P2 = [-0.12, 0.1905, 0.1]"
    old = client.post(
        "/c/hall/fill", content=json.dumps({"line": line, "said": ["1", "1", "1"], "seen": seen})
    )
    assert "changed elsewhere" in old.json()["problem"]


@pytest.mark.parametrize("name", ["--help", "--json", "-x"])
def test_a_name_is_no_option(client, name):
    """What reads like an option of the commands names no campaign."""
    said = client.post("/campaigns", content=json.dumps({"name": name}))

    assert "plain name" in said.json()["problem"]


@pytest.mark.whole
def test_a_wrong_point_is_not_accepted(demo, tmp_path):
    """`check` says what to correct and to check again: nothing is armed."""
    path = tmp_path / "data" / "raw" / "hall" / "campaign.toml"
    path.write_text(path.read_text().replace("P1 = [0.2,", "P1 = [0.23,"))

    demo.post("/c/hall/check")

    assert "Not accepted" in demo.get("/c/hall/check").text
    assert demo.post("/c/hall/run").status_code == 400


@pytest.mark.whole
def test_what_is_broken_in_the_terminal_is_mended_here(demo, tmp_path):
    """The text of campaign.toml is there, whatever it says."""
    path = tmp_path / "data" / "raw" / "hall" / "campaign.toml"
    path.write_text(path.read_text().replace("P1 = [0.2, 0.05, 0.12]", "P1 = [0.2, 0.05"))

    page = demo.get("/c/hall/setup")

    assert page.status_code == 200
    assert "P1 = [0.2, 0.05" in page.text


@pytest.mark.whole
def test_a_campaign_of_the_terminal_opens(client, tmp_path):
    """Whatever was begun elsewhere goes on here, with what it waits for."""
    shutil.copytree(DEMO, tmp_path / "data" / "raw" / "kr500_demo")

    assert 'href="/c/kr500_demo/check"' in client.get("/").text


@pytest.mark.parametrize(
    ("method", "way", "body"),
    [("POST", "/campaigns", b"\xff"), ("POST", "/campaigns", b"[]"),
     ("POST", "/campaigns", b'{"name": "a/b"}'),
     ("POST", "/c/hall/fill", b'{"line": "x"}'), ("POST", "/c/hall/fill", b"{}"),
     ("POST", "/c/hall/text", b'{"text": "a = ", "seen": ""}'), ("GET", "/c/other/files", b""),
     ("POST", "/c/hall/fill", b"x" * (2**20 + 1)), ("PUT", "/c/hall/file/a.zip", b"PK\x03\x04 no"),
     ("POST", "/c/hall/fill", b"[" * 10**5), ("POST", "/c/hall/fill", b'{"line": [2]}'),
     ("POST", "/c/hall/fill", b'{"line": 1e999, "confirm": 1}')],
    ids=range(12),
)  # fmt: skip
def test_what_cannot_be_taken_is_a_sentence(demo, method, way, body):
    """Never an internal error."""
    answer = demo.request(method, way, content=body)

    assert answer.status_code == 400
    assert "internal error" not in answer.text
    assert answer.json()["problem"]


@pytest.mark.whole
def test_a_campaign_file_that_is_nested_too_deeply_is_shown(demo, tmp_path):
    """It is text to correct, as anything else that is not TOML."""
    (tmp_path / "data/raw/hall/campaign.toml").write_text("x = " + "[" * 5000)

    answer = demo.get("/c/hall/setup")

    assert answer.status_code == 200
    assert "[[[[" in answer.text


def test_a_line_that_is_put_in_moves_no_other():
    """Only what differs stands beside each other, by its line in the program as it was."""
    rows = [*server._side_by_side(["a", "b", "c"], ["; corrected", "a", "B", "c"])]

    assert [(row["line"], row["old"], row["new"]) for row in rows] == [
        (1, "", "; corrected"), (2, "b", "B")
    ]  # fmt: skip


@pytest.mark.sampled(1)
@pytest.mark.parametrize("at", [0, 3, 30_000])
def test_a_long_program_with_lines_put_in_differs_where_it_was_changed(at):
    """Every other of 60 000 lines is a motion that was moved, those between are all alike."""
    old = [f"LIN {k}" if k % 2 else "WAIT" for k in range(60_000)]
    new = [f"{line}.5" if line != "WAIT" else line for line in old]

    rows = [*server._side_by_side(old, [*new[:at], "; one", "; two", *new[at:]])]

    put_in = [(row["line"], row["new"]) for row in rows if not row["old"]]
    assert put_in == [(at + 1, "; one"), (at + 1, "; two")]
    assert [row["line"] for row in rows if row["old"]] == [*range(2, 60_001, 2)]


SRC = "DEF part()\n$BASE=$NULLFRAME\n$TOOL=$NULLFRAME\nLIN XP1\nEND\n"
AT = "X 3240.228,Y 7819.707,Z 1368.394,A -117.033,B -23.82,C -102.579,E1 8500.0"
DAT = f"DEFDAT part\nDECL E6POS XP1={{{AT}}}\nENDDAT\n"


@pytest.mark.whole
def test_the_points_of_a_program_are_read_beside_it(demo):
    """A .src says which are driven and how, its .dat where they are: one is corrected, by both."""
    demo.post("/c/hall/check")
    demo.post("/c/hall/run")
    until(demo, "done")

    def corrected(name, text, other="", more=""):
        ask = {"force": "0,0,-800", "start": "8500,10,-35,51,-81,-22,10"}
        ask |= {"beside": other, "first": str(len(text))} if other else {}
        sent = (text + more).encode()
        return demo.post(f"/c/hall/correct/{name}", params=ask, content=sent).json()

    both = corrected("part.dat", DAT, "part.src", SRC)
    assert both["problem"] == ""
    assert any("XP1" in row["old"] and row["old"] != row["new"] for row in both["rows"])
    assert "LIN" not in both["corrected"]
    assert "XP1" in corrected("part.src", SRC)["problem"]
    assert "plain" in corrected("part.src", SRC, "../part.dat", DAT)["problem"]


@pytest.mark.whole
def test_a_log_that_was_not_recognised_is_chosen_among_the_files(client, tmp_path):
    """Titles that nobody knows: its name is not to be typed."""
    drop(client, DEMO / "tracker.csv", DEMO / "joints.csv")
    odd = (DEMO / "loads.csv").read_text().replace("force_n", "kraft am haken")
    client.put("/c/hall/file/hook.csv", content=odd.encode())
    client.post("/c/hall/init")
    page = client.get("/c/hall/setup").text
    text = (tmp_path / "data" / "raw" / "hall" / "campaign.toml").read_text()

    assert "# file" in text
    assert "<option>hook.csv</option>" in page


@pytest.fixture
def untitled(here, client):
    """An export whose titles say nothing: U, V and W are the coordinates, T is the temperature."""
    drop(client, DEMO / "joints.csv", DEMO / "loads.csv")
    rows = [one.split(",") for one in (DEMO / "tracker.csv").read_text().splitlines()[1:]]
    odd = [f"{r[0]};{r[1]};20.1;{r[2]};{r[3]};{r[4]};0.01" for r in rows]
    client.put("/c/hall/file/odd.csv", content="\n".join(["G;P;T;U;V;W;S", *odd, ""]).encode())
    return client


RIGHT = {"1": "group", "2": "target", "4": "x", "5": "y", "6": "z"}


@pytest.mark.whole
def test_what_a_column_is_can_be_chosen(untitled, tmp_path):
    """What is chosen is read at once, and nothing more is asked about the columns."""
    proposed = untitled.get("/c/hall/look/odd.csv").text
    right = RIGHT | {"seen": proposed.partition('name="seen" value="')[2].partition('"')[0]}
    twice, said = (
        untitled.post("/c/hall/columns/odd.csv", content=json.dumps(typed)).json()
        for typed in (right | {"7": "z"}, right)
    )
    text = (tmp_path / "data" / "raw" / "hall" / "campaign.toml").read_text()
    stated = tomllib.loads(text)

    assert said == {"problem": ""}
    assert twice == {"problem": 'columns W and S are both "z".'}
    assert "<option selected>x" in proposed
    assert stated["tracker"]["mapping"]["columns"] == {
        "group": "G", "target": "P", "x": "U", "y": "V", "z": "W"
    }  # fmt: skip
    assert "# columns = ?" not in text
    assert stated["naming"]["measured"] == ["P1", "P2", "P3"]
    assert "-2361.79" in untitled.get("/c/hall/look/odd.csv").text


def test_a_link_in_a_circle_is_no_file_of_the_report(client, tmp_path):
    """A sentence, as for any name that is not there."""
    client.post("/campaigns", content='{"name": "hall"}')
    (tmp_path / "reports" / "hall").mkdir(parents=True)
    (tmp_path / "reports" / "hall" / "round").symlink_to("round")
    for path in ("round", "round/index.html", "none"):
        answer = client.get(f"/c/hall/report/{path}")

        assert answer.status_code == 400
        assert "there is no such file in the report" in answer.json()["problem"]
