"""The code page of a text, by the letters and the frequent characters of languages."""

from __future__ import annotations

import re
from contextlib import suppress

_LETTERS = {
    "cp1252": ("äöüß", "àâæçèéêëîïôœùûüÿ", "àèéìíîòóùú", "áéíñóúüªº", "àáâãçéêíóôõúüªº", "åæéòóôø",
               "äåéö", "áèéêëïóöü"),
    "cp1250": ("áčďéěíňóřšťúůýž", "ąćęłńóśźż", "áéíóöőúüű", "áäčďéíĺľňóôŕšťúýž", "čćđšž", "ăâîşţ"),
    "cp1254": ("çğıöşüâîû",),
    "cp1251": ("абвгдеёжзийклмнопрстуфхцчшщъыьэюяіїєґў",),
}  # fmt: skip
"""Letters of a language beside ASCII, by the code page in which it is written; the first fits."""
_ASCII = bytes(range(128))
_NO_LETTER = re.compile(rb"[A-Za-z][\xa3\xa5\xaf\xb3\xb9\xbf]+[A-Za-z]|[\xe0-\xff]\xb3|\x9c[^ui]")
"""Signs as in `si³a`, `dó³` and `œruba` in cp1252, which are letters of Polish in cp1250."""

_FREQUENT = {
    "cp932": (
        r"[\x81-\x83\x88-\x97][\x40-\xfc]",
        "点番号力荷重測定姿軸角距回基準座標工具時間単位温度ポズの",
    ),
    "gb18030": (
        r"[\xa1-\xa9\xb0-\xd7][\xa1-\xfe]",
        "位姿点号力载空组序次数轴角距平天顶坐标基准工具法兰时间单测量机温度锚钩靶",
    ),
    "cp949": (
        r"[\xa1-\xac\xb0-\xc8][\xa1-\xfe]",
        "자세하중힘점번호이축각도거리수평직고좌표기준공구시간단위측정온로봇사의에가지무",
    ),
    "big5": (
        r"[\xa1-\xc6][\x40-\xfe]",
        "位姿點號力載空組序次數軸角距平天頂座標基準工具法蘭時間單測量機溫度錨鉤靶",
    ),
}
"""Bytes of the frequent characters (kana and the first level of its standard) by the code page of
two bytes per letter, and letters of the field, which decide where several fit or few are there."""
_MANY = 8
"""Number of different letters that are no chance without one of the field [1]."""
_CAPITALS = re.compile(rb"[\x00-\x7f\xc0-\xdf]*")
"""Bytes that are letters of one byte, such as Cyrillic capitals, if there are no others."""
_BEGIN = 1 << 16
"""Size of the text by which a page of two bytes is found [byte]."""


def page(data: bytes) -> str:
    """The code page by the characters of a text, else cp1252.

    That of two bytes per letter in which nine in ten are frequent, or that of one byte in which all
    letters are those of one language.
    """
    return _of_two_bytes(data) or _of_one_byte(data)


def _of_two_bytes(data: bytes) -> str | None:
    """The page in which a text is valid and nearly all its letters are frequent; None if none."""
    lines = [one for one in data[:_BEGIN].splitlines() if not one.isascii()]
    begin = b"\n".join(lines[:-1] if len(data) > _BEGIN else lines)
    names = () if _CAPITALS.fullmatch(begin) else _FREQUENT
    fitting = {name: _letters(begin, data, name) for name in names}
    most = max(fitting, key=fitting.__getitem__, default="")
    return most if most and fitting[most] else None


def _letters(begin: bytes, data: bytes, name: str) -> int:
    """Number of letters of the field in a page, 1 for many others; 0 if a text is not of it."""
    frequent, known = _FREQUENT[name]
    with suppress(UnicodeDecodeError):
        letters = [one for one in begin.decode(name) if not one.isascii()]
        coded = (one.encode(name).decode("latin-1") for one in letters)
        usual = sum(re.fullmatch(frequent, one) is not None for one in coded)
        data.decode(name)
        if usual >= 0.9 * len(letters):
            return len({*letters} & {*known}) or int(len({*letters}) >= _MANY)
    return 0


def _of_one_byte(data: bytes) -> str:
    """The page in which all letters of a text are those of one language, else cp1252."""
    others = bytes({*data.translate(None, _ASCII)})
    for name, alphabets in _LETTERS.items():
        shown = others.decode(name, "replace").lower()
        letters = {one for one in shown if one.isalpha() or one == "\ufffd"}
        signs = name == "cp1252" and _NO_LETTER.search(data)
        if not signs and any(letters <= {*one, "µ"} for one in alphabets):
            return name
    return "cp1252"
