"""An S3 server whose objects may have any name, any false metadata and any other content."""

import contextlib
import http.server
import time
from datetime import UTC, datetime
from email.utils import formatdate
from hashlib import md5
from urllib.parse import parse_qs, quote, unquote, urlsplit
from xml.sax.saxutils import escape

LONG_AGO = 1_700_000_000
"""Default time at which objects were stored [s since 1970]."""


def handler(
    objects,
    listed=None,
    refused=(),
    times=None,
    changed=None,
    broken=None,
    more=False,
    unlisted=(),
    stated=None,
    given=None,
    slow=(),
    digests=True,
):
    """A handler of requests for one bucket.

    Args:
        objects: Content by name.
        listed: Content by name as listings tell of it, where that differs.
        refused: Names of which nothing is given, as of archived objects.
        times: When an object was put there, by name, as listings tell it [s since 1970].
        changed: The same, as the object tells it itself.
        broken: Status and code of an error that is answered, by name; that of the listing is empty.
        more: Each listing says that there is more.
        unlisted: Names that listings leave out.
        stated: Content by name by which an object is described, where that differs.
        given: Content by name that is given, or a function that makes it anew each time.
        slow: Names whose content comes a byte in a second.
        digests: Whether objects have an `ETag` of one part.
    """

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_HEAD(self):
            self._object(body=False)

        def do_GET(self):
            query = parse_qs(urlsplit(self.path).query, keep_blank_values=True)
            listing = "list-type" in query or not self._name()
            if wrong := (broken or {}).get("" if listing else self._name()):
                self._answer(wrong[0], f"<Error><Code>{wrong[1]}</Code></Error>".encode())
            elif listing:
                said = {word: values[0] for word, values in query.items()}
                told = {**objects, **(listed or {})}
                told = {name: told[name] for name in told if name not in unlisted}
                self._answer(200, _listing(told, times or {}, more, **_known(said)))
            else:
                self._object(body=True)

        def _name(self):
            return unquote(urlsplit(self.path).path).removeprefix("/robots").removeprefix("/")

        def _time(self):
            return (changed or {}).get(self._name(), LONG_AGO)

        def _object(self, body):
            name = self._name()
            if name in refused:
                self._answer(403, b"<Error><Code>InvalidObjectState</Code></Error>", body)
            elif name not in objects:
                self._answer(404, b"<Error><Code>NoSuchKey</Code></Error>", body)
            else:
                data = ((given if body else stated) or {}).get(name, objects[name])
                self._answer(200, data() if callable(data) else data, body, name in slow)

        def _answer(self, code, data, body=True, slowly=False):
            whole, first = len(data), 0
            asked = self.headers.get("Range")
            if asked and code == 200 and data:
                first, last = (int(one or whole) for one in asked.removeprefix("bytes=").split("-"))
                data, code = data[first : last + 1], 206
            self.send_response(code)
            self.send_header("Content-Length", str(len(data)))
            if code == 206:
                self.send_header("Content-Range", f"bytes {first}-{first + len(data) - 1}/{whole}")
            self.send_header("ETag", f'"{md5(data).hexdigest()}{"" if digests else "-2"}"')
            self.send_header("Last-Modified", formatdate(self._time(), usegmt=True))
            self.end_headers()
            step = 1 if slowly else len(data) + 1
            with contextlib.suppress(OSError):  # nobody waits any more
                for first in range(0, len(data) if body else 0, step):
                    self.wfile.write(data[first : first + step])
                    time.sleep(slowly)

        def log_message(self, *_):
            pass

    return Handler


def _stamp(time_s):
    return datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")


def _known(said):
    words = {"prefix": "prefix", "delimiter": "delimiter", "encoding-type": "encoding"}
    return {words[word]: value for word, value in said.items() if word in words}


def _listing(objects, times, more, prefix="", delimiter="", encoding=""):
    shown = quote if encoding == "url" else escape
    entries, folders = [], {}
    for name, data in sorted(objects.items()):
        if not name.startswith(prefix):
            continue
        rest = name[len(prefix) :]
        if delimiter and delimiter in rest:
            folders[prefix + rest.partition(delimiter)[0] + delimiter] = None
            continue
        entries.append(
            f"<Contents><Key>{shown(name)}</Key>"
            f"<LastModified>{_stamp(times.get(name, LONG_AGO))}</LastModified>"
            f'<ETag>"{md5(data).hexdigest()}"</ETag><Size>{len(data)}</Size></Contents>'
        )
    truncated = "true</IsTruncated><NextContinuationToken>t</NextContinuationToken>"
    end = truncated if more else "false</IsTruncated>"
    common = [f"<CommonPrefixes><Prefix>{shown(f)}</Prefix></CommonPrefixes>" for f in folders]
    return (
        '<?xml version="1.0"?><ListBucketResult><Name>robots</Name>'
        f"<Prefix>{shown(prefix)}</Prefix><KeyCount>{len(entries)}</KeyCount><MaxKeys>1000</MaxKeys>"
        f"{'<EncodingType>url</EncodingType>' if encoding else ''}"
        f"<IsTruncated>{end}{''.join(entries + common)}</ListBucketResult>"
    ).encode()
