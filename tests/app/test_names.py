"""Names, settings and files that somebody made up: one sentence, soon, and the others go on."""

import json
import os
import time
import tomllib
import unicodedata
import xml.etree.ElementTree as ET

import pyarrow as pa
import pytest
import report_sample

from pipeline.app import cli
from pipeline.base import files, patterns, toml
from pipeline.base.errors import InputError, PipelineError
from pipeline.base.shown import in_json, in_toml, printable
from pipeline.design.poses import default_anchors
from pipeline.exchange._xml import in_xml
from pipeline.exchange.files import simulators
from pipeline.fleet import history, pages
from pipeline.library import model_file
from pipeline.machine.robot import load
from pipeline.machine.robot import mdh as robots
from pipeline.reduction.settings import parse
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import CampaignFolder, dump, every, find, in_memory

GOOD = simulate(Plan(name="c", poses={"count": 8})).files
ODD = 'a\x1b[31m\x7f\x9b\u202e\udcff😀\U000e0041\n\t"\\'
SECONDS = 5.0
"""Far more than a few lines need on a busy machine; a hang is longer."""


def put(root, name="c", **content):
    """A good campaign, with some of its files otherwise."""
    folder = root / "data" / "raw" / name
    folder.mkdir(parents=True)
    for file, data in (GOOD | content).items():
        (folder / file).write_bytes(data)
    return folder


def settings(old, new):
    """campaign.toml with some text replaced."""
    text = GOOD["campaign.toml"].decode()
    assert old in text
    return text.replace(old, new, 1).encode("utf-8", "surrogateescape")


@pytest.fixture
def say(tmp_path, capsys):
    """Type a command; its exit code, stdout and stderr."""

    def typed(*words, root=tmp_path):
        capsys.readouterr()
        code = cli._exit_code([*words, "--root", str(root)])
        return code, *capsys.readouterr()

    return typed


# --- shown and written ----------------------------------------------------------------------------


def test_whatever_a_text_holds_it_is_shown_on_one_line():
    """Nothing of it steers the terminal, and saying it twice says the same."""
    said = printable(ODD)

    assert not {unicodedata.category(sign) for sign in said} & {"Cc", "Cf", "Cs", "Zl", "Zp"}
    assert r"a\x1b[31m\x7f\x9b\u202e\xff😀" in said
    assert len(printable("\x1b" * 10**6, 80)) == 80
    assert printable(printable("\x1b" * 1000, 80), 80) == printable("\x1b" * 1000, 80)


def test_whatever_a_text_holds_json_toml_and_xml_hold_it():
    """JSON gives back every sign, TOML all that it knows, XML stays well-formed."""
    kept = ODD.replace("\udcff", "\ufffd")

    assert json.loads(in_json({ODD: ODD}, 2)) == {ODD: ODD}
    assert json.loads(dump([ODD]).decode("utf-8")) == [ODD]
    assert tomllib.loads(f"x = {in_toml(ODD)}")["x"] == kept
    assert tomllib.loads(toml.dumps({ODD: ODD}))[kept] == kept
    assert ET.fromstring(f"<!-- {in_xml(ODD)} --><a/>".encode()).tag == "a"


def test_every_message_is_one_line_of_a_bearable_length():
    """Also where a value of 100 kB is what is wrong."""
    long = InputError(f"{ODD}{'x' * 10**5}", "correct it", file=ODD)

    for said in (str(long), long.thing, long.file, str(PipelineError(ODD * 10**5))):
        assert len(said) < 2000
        assert printable(said) == said
    assert str(long).endswith("; correct it.")
    assert str(InputError(**long.parts)) == str(long)


@pytest.mark.whole
def test_a_model_of_any_names_can_be_read_elsewhere():
    """Names beyond ASCII and odd ones: model.toml stays TOML, the others stay XML."""
    made = simulate(Plan(name="c", poses={"count": 8}, pulls={"steps_n": [2000.0]}))
    text = made.files["campaign.toml"].decode().replace("P1", "P😀").replace("\nP😀", '\n"P😀"')
    tracker = made.files["tracker.csv"].replace(b",P1,", ",P😀,".encode())
    changed = {"campaign.toml": text.encode()}
    found = campaign_answer("c--\x1b", in_memory(made.files | changed | {"tracker.csv": tracker}))

    written = simulators(found.model)
    model = model_file.dumps(found.model)

    assert "P😀" in tomllib.loads(model)["tool"]
    for file, tag in (("urdf", "robot"), ("xml", "mujoco"), ("sdf", "sdf")):
        assert ET.fromstring(written[f"model.{file}"].decode()).tag == tag
    assert model_file.parse(model).campaign == "c--\x1b"


def test_files_get_the_rights_that_the_user_gives(tmp_path):
    """The umask decides who reads a report."""
    for mask, rights in ((0o077, 0o600), (0o022, 0o644), (0o027, 0o640)):
        before = os.umask(mask)
        try:
            files.write(tmp_path / "report", b"")
        finally:
            os.umask(before)
        assert (tmp_path / "report").stat().st_mode & 0o777 == rights


# --- settings -------------------------------------------------------------------------------------

TOMLS = {
    "nested lists": "a = " + "[" * 900 + "]" * 900,
    "nested tables": "a = " + "{a=" * 900 + "1" + "}" * 900,
    "long number": "a = " + "9" * 5000,
    "long number of letters": "a = 0x" + "f" * 5000,
    "dotted key": "a." * 100_000 + "b = 1",
    "dotted key of strings": "'a' . \"b\" . " * 50_000 + "b = 1",
    "dotted table": "[" + "a." * 100_000 + "b]",
    "behind a string": "x = '''\n'''\n" + "a." * 100_000 + "b = 1",
    "large": "a = 1\n" * 200_000,
}


@pytest.mark.parametrize("name", TOMLS)
def test_no_settings_take_long_or_break(name):
    """Whatever is written: one sentence with the file, soon."""
    began = time.perf_counter()
    with pytest.raises(InputError, match=r"^mine\.toml:"):
        toml.loads(TOMLS[name], "mine.toml")

    assert time.perf_counter() - began < SECONDS


@pytest.mark.parametrize("file", ["campaign.toml", "robot.toml", "pipeline.toml", "plan.toml"])
@pytest.mark.parametrize("text", ["nested lists", "long number", "dotted key", "large"])
def test_the_same_holds_for_each_file_that_people_write(file, text, tmp_path, say):
    """Exit 5 and the name of the file."""
    folder, words = put(tmp_path), ["check", "c"]
    home = {"pipeline.toml": tmp_path, "plan.toml": tmp_path}.get(file, folder)
    (home / file).write_text(TOMLS[text])
    if file == "robot.toml":
        (folder / "campaign.toml").write_bytes(settings('"kr500_rail"', '"robot.toml"'))
    elif file == "pipeline.toml":
        words = ["run", "--engine", "local"]
    elif file == "plan.toml":
        words = ["simulate", str(home / file)]
    code, _, err = say(*words)

    assert code == 5
    assert f"{file}:" in err
    assert len(err.splitlines()) == 1
    assert len(err) < 2000


def test_dots_in_strings_and_comments_are_no_key():
    """Nor are those of many numbers on a line."""
    dots = "a." * 50
    text = f'# {dots}b\nx = \'{dots}\'\ny = """\n{dots}"""\nz = {[0.5] * 50}'

    assert toml.loads(text, "mine.toml")["x"] == dots


GROUPS = [
    "a{99999999999}",
    "(" * 3000,
    "(?P<pose>" * 40,
    "(?P<pose>a)(?=b)",
    "[",
    "\\\\",
    "(?P<pose>.)(?P<pose>.)",
]


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group[:30])
def test_an_expression_that_cannot_be_is_told(group):
    """The word, and what an expression may be."""
    text = settings("[naming]", f"[naming]\ngroup = '{group}'").decode()
    with pytest.raises(InputError, match=r"campaign\.toml:\d+: naming\.group: "):
        parse(text)


def test_no_expression_takes_long():
    """Python's own way takes 2**200 steps for these."""
    names = pa.array([*(f"{'a' * 190}{k}!" for k in range(1000)), "a" * 10_000, "aa"])
    began = time.perf_counter()
    for one in (
        r"(?P<all>(a+)+)",
        r"(?P<all>(a|aa)+)",
        r"(?P<all>(.*)*(\w*)*b?)",
        "(?P<all>(a?){200}a{200})",
    ):
        patterns.parts(names, one)

    assert time.perf_counter() - began < SECONDS
    assert patterns.parts(names, r"(?P<all>(a+)+)").is_valid().to_pylist()[-2:] == [False, True]


def test_an_expression_means_what_people_expect():
    """Letters of all languages, classes, brackets as signs, parts without names."""
    fits = [
        (r"(?P<a>\w+)_(x|y)\Z", "Prüfung_y", "Prüfung"),
        (r"[\w·]+(?P<a>\d)[)(\]]", "ß·3(", "3"),
        (r"(?i)POSE\((?P<a>[^\W_]+)\)\W", "pose(7)·", "7"),
        (r"\\(?P<a>[[:alpha:]]+)[^]]", "\\ab!", "ab"),
    ]

    for pattern, name, part in fits:
        assert patterns.named(pattern) == {"a"}
        assert patterns.parts(pa.array([name]), pattern).to_pylist() == [{"a": part}], pattern


NAMES = ["a\x1b[31mb", "a\u202eb", "a\nb", " ", "x" * 201, "\x7f"]


@pytest.mark.parametrize("name", NAMES, ids=printable)
def test_names_that_cannot_be_shown_are_refused(name):
    """With file and line, in every place where a name is typed."""
    quoted = in_toml(name)
    text = GOOD["campaign.toml"].decode()
    for old, new in (
        ('name = "c"', f"name = {quoted}"),
        ("P1 = ", f"P1 = [0, 0, 0]\n{quoted} = "),
        ('measured = ["P1"', f'measured = ["P1", {quoted}'),
        ('file = "loads.csv"', f"file = {quoted}"),
        ('"kr500_rail"', quoted),
    ):
        assert old in text
        with pytest.raises(InputError, match=r"^campaign\.toml:\d+: (?!not valid)") as refused:
            parse(text.replace(old, new, 1))
        assert printable(str(refused.value)) == str(refused.value)


# --- files of a campaign --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "glob", ["", "***", "a**b", "a\\u0000b", "../*.csv", "/etc/*", ".", "a/../b"]
)
def test_a_glob_that_cannot_be_is_told(glob):
    """Before anything is looked for."""
    with pytest.raises(InputError, match=r"campaign\.toml:\d+: tracker\.files\.0: "):
        parse(settings('["tracker.csv"]', f'["{glob}"]').decode())


def test_globs_find_what_they_say(tmp_path):
    """Stars stay within a folder, two of them do not, and each file is read once."""
    folder = put(tmp_path)
    for name in ("one.csv", "a/two.csv", "a/b/three.csv", "a/four.txt"):
        (folder / "more" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "more" / name).write_bytes(b"")
    found = CampaignFolder(tmp_path, folder)._matching

    assert found(["more/*.csv"]) == ["more/one.csv"]
    assert found(["more/*/*.csv"]) == ["more/a/two.csv"]
    assert found(["more/**/*.csv"]) == ["more/a/b/three.csv", "more/a/two.csv", "more/one.csv"]
    assert found(["**/t*", "tracker.csv", "none.csv"]) == [
        "more/a/b/three.csv", "more/a/two.csv", "tracker.csv", "tracker.csv",
    ]  # fmt: skip


def test_a_file_has_one_name_and_patterns_are_few(tmp_path):
    """However it is written, a file is read once; and no thousand patterns are tried."""
    text = settings('["tracker.csv"]', '["./tracker.csv", "tracker*.csv"]')
    folder = put(tmp_path, **{"campaign.toml": text})
    many = json.dumps([f"{k}*" for k in range(1000)])

    assert [*CampaignFolder(tmp_path, folder).read().files].count("tracker.csv") == 1
    assert len(CampaignFolder(tmp_path, folder).read().files) == len(GOOD)
    with pytest.raises(InputError, match="more than 20 patterns"):
        parse(settings('["tracker.csv"]', many).decode())


@pytest.mark.whole
def test_an_export_at_the_top_is_found_by_two_stars(tmp_path, say):
    """They may stand for no folder at all, to those who look and to those who read."""
    put(tmp_path, **{"campaign.toml": settings('["tracker.csv"]', '["**/tracker*.csv"]')})

    assert say("check", "c")[0] == 0


def test_no_glob_costs_more_than_looking_through_the_folder(tmp_path, say):
    """Sixty folders, one in the other, and a link that leads round in a circle."""
    folder = put(
        tmp_path, **{"campaign.toml": settings('["tracker.csv"]', '["**/**/**/**/*.csx"]')}
    )
    os.makedirs(folder.joinpath(*"d" * 60))
    (folder / "d" / "round").symlink_to(folder)
    began = time.perf_counter()
    code, _, err = say("check", "c")

    assert code == 5
    assert "the tracker export is missing" in err
    assert time.perf_counter() - began < SECONDS


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["tracker.csv", "robot.toml", "joints.csv", "campaign.toml"])
def test_a_file_that_leads_out_of_its_folder_is_refused(name, tmp_path, say):
    """Nothing of the machine is read for a campaign; a link inside is as good as a file."""
    folder = put(tmp_path)
    inside = folder / "kept"
    content = load("kr500_rail").text.encode() if name == "robot.toml" else GOOD[name]
    if name == "robot.toml":
        (folder / "campaign.toml").write_bytes(settings('"kr500_rail"', '"robot.toml"'))
    inside.write_bytes(content)
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to("kept")
    assert find(tmp_path, "c").read().files[name] == content

    (tmp_path / "outside").write_bytes(content)
    devices = () if name == "campaign.toml" else ("/proc/self/environ", "/dev/zero")
    for outside in (tmp_path / "outside", *devices):
        (folder / name).unlink()
        (folder / name).symlink_to(outside)
        code, _, err = say("check", "c")
        assert code == 5
        assert f"{name}: leads out of the campaign's folder; put a copy of the file there." in err


def test_a_robot_file_elsewhere_is_refused(tmp_path, say):
    """It belongs to the campaign, and is kept with it."""
    (tmp_path / "mine.toml").write_text(load("kr500_rail").text)
    for where in ("../../../mine.toml", str(tmp_path / "mine.toml")):
        folder = put(
            tmp_path, f"c{len(where)}", **{"campaign.toml": settings('"kr500_rail"', f'"{where}"')}
        )
        code, _, err = say("check", folder.name)
        assert code == 5
        assert "lies outside the campaign folder" in err


def test_a_large_file_is_refused_unread(tmp_path, say):
    """By its size, and by how it begins."""
    folder = put(tmp_path)
    with (folder / "tracker.csv").open("wb") as sparse:
        sparse.truncate(3_000_000_000)
    code, _, err = say("check", "c")
    assert code == 5
    assert "tracker.csv: has 3.0 GB, more than the 2 GB that are read" in err

    with (folder / "tracker.csv").open("r+b") as sparse:
        sparse.write(b"PK\x03\x04")
        sparse.truncate(1_900_000_000)
    began = time.perf_counter()
    assert "Excel" in say("check", "c")[2]
    assert time.perf_counter() - began < 1.0


# --- folders --------------------------------------------------------------------------------------

FOLDERS = [
    "index.html",
    "INDEX.JSON",
    "storage.json",
    "plans",
    "a\nb",
    "a\x1b[31mb",
    "x" * 200,
    "a\\b",
    os.fsdecode(b"\xfe"),
]


@pytest.mark.parametrize("name", FOLDERS, ids=printable)
def test_a_folder_that_can_be_no_campaign_is_told(name, tmp_path, say):
    """The others are computed, what is said of it can be kept, and its way out is to rename it."""
    put(tmp_path, name)
    put(tmp_path, "good", **{"loads.csv": b""})
    for words in (("run", "--engine", "local"), ("run", name, "--engine", "local"), ("status",)):
        code, _, err = say(*words)
        assert code == 5
        assert "rename the folder" in err
        assert printable(err.replace("\n", "")) == err.replace("\n", "")
    odd = next(one for one in every(tmp_path) if one.name == name)
    with pytest.raises(InputError, match="rename the folder"), odd.remembering("key"):
        odd.read()

    assert "rename" in str(odd.rejection("key"))
    assert odd.processed.parent == tmp_path / "data" / "processed"
    assert odd.processed.name.isprintable()


def test_hidden_folders_are_no_campaigns_and_links_are_one(tmp_path):
    """Two links to a folder are the folder; one that leads away is told."""
    put(tmp_path, ".hidden")
    inside, raw = put(tmp_path, "c"), tmp_path / "data" / "raw"
    outside = put(tmp_path / "elsewhere", "away")
    (raw / "b").symlink_to(inside)
    (raw / "d").symlink_to("c")
    (raw / "e").symlink_to(outside)
    (raw / "round").symlink_to("round")
    (raw / "c" / "round").symlink_to("round")

    assert [one.name for one in every(tmp_path)] == ["c", "e"]
    assert find(tmp_path, "d").folder == inside.resolve()
    with pytest.raises(InputError, match=r"a link that leads out of data/raw; put a copy"):
        find(tmp_path, "e").read()
    assert find(tmp_path, str(outside)).read().settings.name == "c"


@pytest.mark.parametrize(
    "name", ["x" * 300, "a\0b", "x/" * 3000], ids=["long", "zero byte", "deep"]
)
@pytest.mark.parametrize("command", ["run", "check", "report", "compensate", "inspect", "init"])
def test_a_name_that_no_folder_can_have_is_told(name, command, tmp_path, say):
    """It is not there, in one sentence."""
    put(tmp_path)
    more = {"compensate": ["path.csv"]}.get(command, [])
    if command == "inspect":
        code = cli._exit_code(["inspect", name])
    else:
        code, _, err = say(command, name, *more)
        assert len(err) < 3000

    assert code in (2, 5)


# --- what earlier runs left -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Two finished campaigns without their computation: a result of one is kept for both."""
    root = tmp_path_factory.mktemp("finished")
    for name in ("a", "b"):
        result = dump(report_sample.answer().as_json() | {"campaign": name})
        files.write(root / "reports" / name / "result.json", result)
        manifest = {"key": "k", "source": f"data/raw/{name}", "outputs": {}}
        files.write(root / "data" / "processed" / name / "manifest.json", dump(manifest))
    return root


@pytest.mark.whole
@pytest.mark.parametrize(
    ("path", "content"),
    [
        ("reports/b/result.json", b'{"campaign": "b", "verd'),
        ("reports/b/result.json", b"[" * 100_000),
        ("reports/b/result.json", b"\xff"),
        ("data/processed/b/manifest.json", b'{"key": "k", "source": 7, "outputs": {}}'),
        ("data/processed/b/manifest.json", b'{"key": "k", "source": null, "outputs": {}}'),
        ("data/processed/b/manifest.json", b'{"key": "k", "source": "a\\u0000", "outputs": {}}'),
        ("data/processed/b/manifest.json", b"[" * 100_000),
    ],
    ids=["cut", "nested", "bytes", "number", "null", "zero byte", "nested manifest"],
)
def test_a_damaged_result_is_left_out(path, content, finished):
    """The other campaigns' runs go on."""
    kept = (finished / path).read_bytes()
    (finished / path).write_bytes(content)
    try:
        left = [one.campaign.name for one in history.finished(finished)]
    finally:
        (finished / path).write_bytes(kept)

    assert "a" in left


def test_the_overview_is_drawn_of_what_is_there_at_last(finished, monkeypatch):
    """Who waited for another run's page does not draw what he had read before."""
    both = history.finished(finished)
    drawn = []
    monkeypatch.setattr(
        "pipeline.fleet.overview.render_overview", lambda all_, wear: drawn.append(len(all_)) or b""
    )

    pages._index(finished, both[:1], ())

    assert drawn == [2]


def test_settings_beside_an_export_may_be_anything(tmp_path, capsys):
    """`inspect` says which file is wrong."""
    folder = put(tmp_path, **{"campaign.toml": "name = 'Größe'".encode("latin-1")})

    assert cli._exit_code(["inspect", str(folder / "tracker.csv")]) == 5
    assert "campaign.toml: is not UTF-8; save it as UTF-8." in capsys.readouterr().err


def test_a_tracker_beside_an_export_that_is_no_table_is_said(tmp_path, capsys):
    """Whatever stands in its place."""
    folder = put(tmp_path, **{"campaign.toml": b"tracker = 3\n"})

    assert cli._exit_code(["inspect", str(folder / "tracker.csv")]) == 5
    assert "campaign.toml: tracker is no table; write [tracker]" in capsys.readouterr().err


def test_a_rejection_names_a_file_also_where_none_is_to_blame(tmp_path, say):
    """The last one to look into is campaign.toml."""
    text = GOOD["campaign.toml"].decode().replace("sigma_m =", "# sigma_m =")
    text = text.replace('measured = ["P1", "P2", "P3"]', 'measured = ["P1", "P2"]')
    first = {n: b"\n".join(GOOD[n].splitlines()[:2]) for n in ("joints.csv", "loads.csv")}
    put(tmp_path, **{"campaign.toml": text.encode()} | first)
    code, out, _ = say("run", "c", "--engine", "local", "--json")

    assert code == 5
    assert json.loads(out)["error"]["file"] == "campaign.toml"


@pytest.mark.whole
def test_terminal_escapes_in_an_export_are_shown_not_obeyed(tmp_path, say, capsys):
    """On stdout and stderr, as text and as JSON."""
    put(tmp_path, **{"tracker.csv": GOOD["tracker.csv"].replace(b"P1", b"\x1b[31mP\xc2\x9b1")})
    export = str(tmp_path / "data" / "raw" / "c" / "tracker.csv")
    for words in (["check", "c"], ["check", "c", "--json"]):
        _, out, err = say(*words)
        assert not {"\x1b", "\x9b"} & {*out, *err}
    for words in (["inspect", export], ["inspect", export, "--json"]):
        assert cli._exit_code(words) == 0
        said = capsys.readouterr().out
        assert not {"\x1b", "\x9b"} & {*said}
        assert "[31mP" in said


def test_a_robot_of_any_words_has_them_checked():
    """Control characters in its description are refused as those in a name are."""
    text = load("kr500_rail").text
    for old, new in (
        ("description = ", 'description = "a\\u001b" # '),
        ('name = "theta2"', 'name = "\\u001b"'),
    ):
        assert old in text
        with pytest.raises(InputError, match=r"^mine\.toml:"):
            robots.parse(text.replace(old, new, 1), "mine.toml")


def test_a_rail_without_ends_is_asked_for():
    """Nobody can spread anchors along it; a short one has its anchor in the middle."""
    text = load("kr500_rail").text
    endless = robots.parse(text.replace("lower_m = 0.0\nupper_m = 18.0\n", ""), "mine.toml")
    short = robots.parse(text.replace("upper_m = 18.0", "upper_m = 1.0"), "mine.toml")

    with pytest.raises(InputError, match="r1 reaches from -inf to inf m"):
        default_anchors(endless)
    assert default_anchors(short)[:, 1].tolist() == [0.5]
