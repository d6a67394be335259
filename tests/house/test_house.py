"""House style: what its folder adds to a certificate, and what it must not."""

import base64
import re
import zlib

import pytest
import report_sample
from pdf_text import pages_of

from pipeline.base.appearance import Appearance
from pipeline.base.errors import InputError
from pipeline.house import house
from pipeline.house.appearances import appearances
from pipeline.report.certificate import certificate
from pipeline.report.model import compose
from pipeline.report.render import render

LOGO = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" width="9" height="9">'
    '<rect width="9" height="9" fill="#0072b2"/></svg>'
)
SAID = """
logo = "logo.svg"
order = ["stiffness", "test-pose"]

[fields]
"Order" = "{{ fields.order }}"
"Plan" = "QS-{{ robot }}, {{ tolerance }}"
"""
FACTS = {"robot": "kr500_rail", "tolerance": "pass"}


@pytest.fixture
def root(tmp_path):
    """A project with a house."""
    folder = tmp_path / "house"
    folder.mkdir()
    (folder / "house.toml").write_text(SAID)
    (folder / "logo.svg").write_text(LOGO)
    (tmp_path / "pipeline.toml").write_text('[report]\nlanguage = "de"\ntemplates = "house"\n')
    return tmp_path


@pytest.mark.whole
def test_a_certificate_has_what_the_house_adds(root):
    """Logo, lines with fields of campaign.toml, and annexes in its order, on page and PDF."""
    look = appearances(root)({"fields": {"order": "4711"}}, FACTS)
    answer, tables = report_sample.answer(), report_sample.tables()
    keys = [one.key for one in compose(answer, tables, look=look).sections]
    plain = [one.key for one in compose(answer, tables).sections]
    made = render(answer, tables, look=look)
    page, first = made["index.html"].decode(), pages_of(made["report.pdf"])[0]

    assert look == Appearance(
        "de", LOGO, (("Order", "4711"), ("Plan", "QS-kr500_rail, pass")), ("stiffness", "test-pose")
    )
    assert keys[:2] == ["stiffness", "test-pose"]
    assert sorted(keys) == sorted(plain)
    assert [one for one in plain if one not in look.order] == keys[2:]
    assert base64.b64encode(LOGO.encode()).decode() in page
    assert "QS-kr500_rail" in page
    assert "QS-kr500_rail, pass" in first


def test_a_line_without_its_field_is_left_out(root):
    """As everything not stated; the language of campaign.toml takes precedence."""
    look = appearances(root)({"fields": {}, "language": "fr"}, FACTS)

    assert look.fields == (("Plan", "QS-kr500_rail, pass"),)
    assert look.language == "fr"


def test_what_a_campaign_says_is_never_a_template(root):
    """Braces and markup in campaign.toml are plain text, also on the page."""
    evil = "{{ 7 * 7 }}<script>alert(1)</script>"
    look = appearances(root)({"fields": {"order": evil}}, FACTS)
    content = certificate(report_sample.answer(), {}, look=look)
    page = render(report_sample.answer(), {}, look=look)["index.html"].decode()

    assert content.filed[-2].text == evil
    assert "<script>alert" not in page
    assert "49&lt;script" not in page


HOSTILE = [
    "{{ ''.__class__.__mro__[1].__subclasses__() }}",
    "{{ robot.__init__.__globals__ }}",
    "{{ fields.__class__ }}",
    "{% include '/etc/passwd' %}",
    "{% import 'os' as os %}{{ os }}",
    "{% for k in range(10 ** 9) %}x{% endfor %}",
    "{{ 'x' * 10 ** 10 }}",
    "{{ lipsum() }}",
    "{{ cycler.__init__ }}",
    "{{ robot | attr('__class__') }}",
    "{{ self }}",
    "{% set robot = 1 %}{{ robot }}",
    "{{ robot ",
    "{{ fields['order'] }}",
    "{{ nothing }}",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_a_line_that_does_more_is_refused_in_a_sentence(root, text):
    """It is named with its file, and nothing of it is executed."""
    said = f"[fields]\n\"Line\" = '''{text}'''\n"
    (root / "house" / "house.toml").write_text(said)
    if text == "{{ fields.__class__ }}":  # an ordinary name, which campaign.toml does not have
        assert appearances(root)({"fields": {"order": "1"}}, FACTS).fields == ()
        return
    with pytest.raises(InputError) as refused:
        appearances(root)

    assert "house/house.toml" in str(refused.value)
    assert '"Line"' in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("inside", "told"),
    [
        ("<script>alert(1)</script>", "<script>"),
        ('<image href="file:///etc/passwd"/>', "<image>"),
        ('<use href="other.svg#a"/>', "href="),
        ('<rect onload="alert(1)"/>', "onload="),
        ('<rect fill="url(https://example.org/a)"/>', "fill="),
        ("<foreignObject/>", "<foreignObject>"),
        ("<rect", "no XML"),
    ],
)
def test_a_logo_that_is_no_drawing_is_refused(root, inside, told):
    """Nothing executable, and no external links."""
    logo = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">{inside}</svg>'
    (root / "house" / "logo.svg").write_text(logo)

    with pytest.raises(InputError, match=re.escape(told)):
        appearances(root)


def test_nothing_outside_the_folder_is_read(root, tmp_path):
    """Neither by a name, nor by a link, nor from the folder of campaigns."""
    (tmp_path / "secret.svg").write_text(LOGO)
    (root / "house" / "house.toml").write_text('logo = "../secret.svg"\n')
    with pytest.raises(InputError, match="outside"):
        house(root, "house")
    (root / "house" / "house.toml").write_text('logo = "link.svg"\n')
    (root / "house" / "link.svg").symlink_to(tmp_path / "secret.svg")
    with pytest.raises(InputError, match="leads out of its folder"):
        house(root, "house")
    with pytest.raises(InputError, match="lies among campaigns"):
        house(root, "data/raw/hall")


def chunk(kind, data):
    """A part of a PNG."""
    body = kind + data
    return len(data).to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")


def test_a_png_is_a_logo_too(root):
    """With any number of pixels; page and PDF include it."""
    head = (3).to_bytes(4, "big") + (2).to_bytes(4, "big") + bytes([8, 2, 0, 0, 0])
    rows = zlib.compress(b"".join(b"\0" + b"\x10\x70\xb0" * 3 for _ in range(2)))
    image = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    (root / "house" / "logo.png").write_bytes(image)
    (root / "house" / "house.toml").write_text('logo = "logo.png"\n')
    look = appearances(root)({}, FACTS)

    assert 'viewBox="0 0 3 2"' in look.logo
    assert render(report_sample.answer(), {}, look=look)["report.pdf"].startswith(b"%PDF")


def test_the_order_knows_every_annex_of_a_report(root):
    """Every annex of a report can be named by a house, and an unknown one is refused."""
    from typing import get_args

    from pipeline.house.folder import Annex

    answer, tables = report_sample.answer(), report_sample.tables()
    assert {one.key for one in compose(answer, tables).sections} <= {*get_args(Annex)}
    (root / "house" / "house.toml").write_text('order = ["stifness"]\n')
    with pytest.raises(InputError, match="stifness"):
        appearances(root)


def test_without_a_house_nothing_changes(tmp_path):
    """No pipeline.toml: English, and the default order."""
    assert appearances(tmp_path)({}, FACTS) == Appearance()
    (tmp_path / "pipeline.toml").write_text('[report]\ntemplates = "lost"\n')
    with pytest.raises(InputError, match=r"lost/house\.toml"):
        appearances(tmp_path)
