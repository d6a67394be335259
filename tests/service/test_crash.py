"""What is sent with an internal error: where and what, and nothing of a customer."""

import errno
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.app.outcome import guarded, record_crash
from pipeline.service.crash import shareable

SECRET = ("ACME", "halle7", "Müller", "1234.567", "-87.5", "P_tip", "/srv/kunden")


def spoilt(text):
    """Errors of several libraries, in whose words a customer's own text stands."""
    try:
        try:
            float(text)
        except ValueError as first:
            raise KeyError(text) from first
    except KeyError as second:
        return second


@pytest.mark.parametrize("number", [errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC])
def test_a_file_of_another_user_is_no_crash(number):
    """Wherever it is met: exit code 3, with the file, and no report of an internal error."""

    def work():
        raise OSError(number, os.strerror(number), "/srv/reports/a/index.html")

    one = guarded("a", work)

    assert one.exit_code == 3
    assert os.strerror(number) in one.complaints[0]
    assert "internal error" not in one.complaints[0]


@pytest.mark.parametrize("secret", SECRET)
def test_nothing_of_a_customer_is_in_it(secret):
    """Names, values and paths in the words of an exception stay at home."""
    for problem in (spoilt(f"{secret} of ACME"), RuntimeError(f"{secret} is odd: {secret}")):
        sent = shareable(problem)

        assert secret not in sent
        assert "ACME" not in sent


def test_it_says_where_and_what():
    """Module, function and line of ours; kinds of errors in their order; shapes."""
    try:
        np.linalg.solve(np.zeros((3, 4)), np.zeros(3))
    except np.linalg.LinAlgError as problem:
        sent = shareable(problem)

    assert re.search(r"numpy/linalg/\S+:\d+ solve", sent)
    assert "must be square" in sent
    assert shareable(spoilt("x")).index("ValueError") < shareable(spoilt("x")).index("KeyError")


def test_folders_of_the_machine_are_not_in_it():
    """Where the program and somebody's script lie is nobody's business."""
    try:
        json.loads("{")
    except ValueError as problem:
        sent = shareable(problem)

    assert str(Path.home()) not in sent
    assert Path(__file__).name not in sent


def test_the_sentence_names_the_file():
    """One sentence on the screen, and the file that it names holds what is sent."""

    def fails():
        raise ZeroDivisionError("division by zero at ACME")

    said = guarded("ACME", fails)

    path = Path(re.search(r"report it with (\S+),", said.complaints[0]).group(1))
    assert path.read_text("utf-8").rstrip().endswith("ZeroDivisionError: division by zero at")
    assert said.exit_code == 1
    assert record_crash(RuntimeError("x")) != record_crash(RuntimeError("division by zero"))
