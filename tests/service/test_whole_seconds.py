"""Times of objects on a storage: whole seconds when read, fractions when listed."""

import contextlib
import io
from types import SimpleNamespace

import pytest

from pipeline.base.errors import InputError
from pipeline.service.storage import Store

PUT = 1_700_000_000


class _Source(io.BytesIO):
    """An object of four bytes that was put at `PUT`."""

    def size(self):
        return 4

    def metadata(self):
        return {b"Last-Modified": b"2023-11-14T22:13:20+00:00"}


@pytest.mark.parametrize(("listed", "taken"), [(0.0, True), (0.7, True), (30.0, False)])
def test_a_fraction_of_a_second_is_no_later_version(listed, taken):
    """The same object is listed 0.7 s later than it says; half a minute is another version."""
    store = Store("s3://robots/raw")
    files = SimpleNamespace(open_input_file=lambda _: _Source(b"1,2\n"))
    store.__dict__["_opened"] = (files, "robots/raw")
    told = contextlib.nullcontext() if taken else pytest.raises(InputError, match="not as it is")

    with told:
        assert store.read("a/loads.csv", (4, PUT + listed)) == b"1,2\n"
