"""Stamp of a corrected program, which prevents it from being corrected twice.

The remark stands where the controller accepts one and where it changes nothing: below the head of a
KRL, RAPID or URScript routine or module (KRL wants its `&` lines first, RAPID its `%%%` header),
and behind the last line of a TP program, so that no line number changes. TP's COMMENT has only 16
characters and belongs to the author.
"""

from __future__ import annotations

import hashlib
import re
import textwrap

from pipeline.base.errors import InputError
from pipeline.programs.languages import language

_MARK = "Corrected for the load by pipeline"
_FOUND = re.compile(r"[;!#|][ \t]*Corrected for the load by(?: |\s*;\s*\d+:\s*!\|)pipeline\b")
_BEGUN = "!|"
_WIDTH = 30
"""Number of characters of a remark in TP, without `!|`; the pendant takes 32."""
_DIGITS = 12
"""Number of characters of a digest; enough to distinguish texts."""
_EOL = r"[^\r\n]*(?:\r\n|\r|\n)"
_TOP = re.compile(rf"(?:\xef\xbb\xbf)?(?:&{_EOL}|%%%{_EOL}(?:(?!%%%){_EOL})*%%%{_EOL})*")


def _digest(data: bytes) -> str:
    """Digest of a content, short enough to be compared by eye."""
    return hashlib.sha256(data).hexdigest()[:_DIGITS]


def words(version: str, campaign: str, model: bytes, force: str, date: str, text: str) -> str:
    """Text of the stamp of a corrected program or table.

    Args:
        version: Version of this software.
        campaign: Campaign whose model was used.
        model: Content of that model's file.
        force: Force as given, with its frame.
        date: Date of the correction.
        text: The corrected text, without the stamp.
    """
    sentence = (
        f"{_MARK} {version}: campaign {campaign}, model {_digest(model)}, force {force}, {date}, "
        f"text {_digest(text.encode('latin-1', 'replace'))}"
    )
    return sentence.encode("ascii", "replace").decode()


def refuse(file: str, text: str) -> None:
    """Reject a program that has been corrected before, by whichever campaign.

    Raises:
        InputError: It contains a stamp.
    """
    found = _FOUND.search(text)
    if found is not None:
        line = text.count("\n", 0, found.start()) + 1
        thing = "is corrected for the load already"
        raise InputError(thing, "correct the original instead", file=file, line=line)


def stamped(file: str, text: str, sentence: str) -> str:
    """The text with a remark in its language, with the line ends of the file."""
    suffix, own = file.lower()[file.rindex(".") :], language(file)
    end = "\r\n" if "\r\n" in text else "\r" if "\r" in text and "\n" not in text else "\n"
    if suffix not in own.HEADS:
        return _below_motions(text, sentence, end)
    head = re.compile(own.HEADS[suffix] + _EOL, re.MULTILINE | re.IGNORECASE).search(text)
    at = head or _TOP.match(text)
    place = 0 if at is None else at.end()
    return f"{text[:place]}{own.SIGN} {sentence}{end}{text[place:]}"


def _below_motions(text: str, sentence: str, end: str) -> str:
    """A TP program with remarks behind its last line, and LINE_COUNT increased accordingly."""
    positions = re.search(r"^/POS\b", text, re.MULTILINE | re.IGNORECASE)
    place = len(text) if positions is None else positions.start()
    numbers = re.findall(r"^[ \t]*(\d{1,6})[ \t]*:", text[:place], re.MULTILINE)
    last = int(numbers[-1]) if numbers else 0
    pieces = textwrap.wrap(sentence, _WIDTH)
    lines = "".join(f"{last + k:4d}:  {_BEGUN}{piece} ;{end}" for k, piece in enumerate(pieces, 1))
    count = re.compile(r"^(LINE_COUNT\s*=\s*)(\d{1,6})", re.MULTILINE | re.IGNORECASE)
    head = count.sub(lambda one: f"{one[1]}{int(one[2]) + len(pieces)}", text[:place], count=1)
    return head + lines + text[place:]
