"""What a corrected program says of itself, so that nobody corrects it twice.

The remark stands where the controller of the language takes one and where it changes nothing: below
the head of a KRL, RAPID or URScript routine or module (KRL wants its `&` lines first, RAPID its
`%%%` header), and behind the last line of a TP program, where no line gets another number. TP's
COMMENT has 16 letters and is the author's.
"""

from __future__ import annotations

import hashlib
import re
import textwrap

from pipeline.base.errors import InputError

_MARK = "Corrected for the load by pipeline"
_FOUND = re.compile(r"[;!#|][ \t]*Corrected for the load by(?: |\s*;\s*\d+:\s*!\|)pipeline\b")
_BEGUN = "!|"
_WIDTH = 30
"""Letters of a remark in TP [1], without `!|`; the pendant takes 32."""
_DIGITS = 12
"""Letters of a digest [1]: enough to tell texts apart."""
_EOL = r"[^\r\n]*(?:\r\n|\r|\n)"
_HEADS = {
    ".src": rf"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:FCT)?\b{_EOL}",
    ".dat": rf"^[ \t]*DEFDAT\b{_EOL}",
    ".mod": rf"^[ \t]*MODULE\b(?!.*\bENDMODULE\b){_EOL}",
    ".script": rf"^[ \t]*def\b{_EOL}",
}
_ALIKE = {".modx": ".mod", ".prg": ".mod", ".urscript": ".script"}
_SIGNS = {".src": ";", ".dat": ";", ".mod": "!", ".script": "#"}
_TOP = re.compile(rf"(?:\xef\xbb\xbf)?(?:&{_EOL}|%%%{_EOL}(?:(?!%%%){_EOL})*%%%{_EOL})*")


def _digest(data: bytes) -> str:
    """What tells contents apart, short enough to be compared by eye."""
    return hashlib.sha256(data).hexdigest()[:_DIGITS]


def words(version: str, campaign: str, model: bytes, force: str, date: str, text: str) -> str:
    """What a corrected program or table says of itself.

    Args:
        version: Of this software.
        campaign: Whose model corrected it.
        model: That model.
        force: As given, with its frame.
        date: Of the correction.
        text: The corrected text, without this.
    """
    said = (
        f"{_MARK} {version}: campaign {campaign}, model {_digest(model)}, force {force}, {date}, "
        f"text {_digest(text.encode('latin-1', 'replace'))}"
    )
    return said.encode("ascii", "replace").decode()


def refuse(file: str, text: str) -> None:
    """Refuse a program that was corrected before, by whichever campaign.

    Raises:
        InputError: It says so.
    """
    found = _FOUND.search(text)
    if found is not None:
        line = text.count("\n", 0, found.start()) + 1
        thing = "is corrected for the load already"
        raise InputError(thing, "correct the original instead", file=file, line=line)


def stamped(file: str, text: str, said: str) -> str:
    """The text with a remark in the manner of its language, in the file's own line ends."""
    suffix = file.lower()[file.rindex(".") :]
    suffix = _ALIKE.get(suffix, suffix)
    end = "\r\n" if "\r\n" in text else "\r" if "\r" in text and "\n" not in text else "\n"
    if suffix == ".ls":
        return _below_motions(text, said, end)
    head = re.compile(_HEADS[suffix], re.MULTILINE | re.IGNORECASE).search(text)
    at = head or _TOP.match(text)
    place = 0 if at is None else at.end()
    return f"{text[:place]}{_SIGNS[suffix]} {said}{end}{text[place:]}"


def _below_motions(text: str, said: str, end: str) -> str:
    """A TP program with remarks behind its last line; its attributes count them."""
    positions = re.search(r"^/POS\b", text, re.MULTILINE | re.IGNORECASE)
    place = len(text) if positions is None else positions.start()
    numbers = re.findall(r"^[ \t]*(\d{1,6})[ \t]*:", text[:place], re.MULTILINE)
    last = int(numbers[-1]) if numbers else 0
    pieces = textwrap.wrap(said, _WIDTH)
    lines = "".join(f"{last + k:4d}:  {_BEGUN}{piece} ;{end}" for k, piece in enumerate(pieces, 1))
    count = re.compile(r"^(LINE_COUNT\s*=\s*)(\d{1,6})", re.MULTILINE | re.IGNORECASE)
    head = count.sub(lambda one: f"{one[1]}{int(one[2]) + len(pieces)}", text[:place], count=1)
    return head + lines + text[place:]
