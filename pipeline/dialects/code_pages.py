"""The code page of a text of one byte per letter, by the letters of the languages written in it."""

from __future__ import annotations

import re

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


def page(data: bytes) -> str:
    """The code page in which all letters of a text are those of one language, else cp1252."""
    others = bytes({*data.translate(None, _ASCII)})
    for name, alphabets in _LETTERS.items():
        shown = others.decode(name, "replace").lower()
        letters = {one for one in shown if one.isalpha() or one == "\ufffd"}
        signs = name == "cp1252" and _NO_LETTER.search(data)
        if not signs and any(letters <= {*one, "µ"} for one in alphabets):
            return name
    return "cp1252"
