"""Forces from what a scale shows, where its zero and its gain are known."""

import csv
import io
import re

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.check.findings import scale_findings
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

FILES = dict(simulate(Plan(name="s", seed=3, poses={"count": 4})).files)


def shown(by, stated=""):
    """Loads and settings of the campaign with another scale, whose readings are by(force)."""
    rows = list(csv.DictReader(io.StringIO(FILES["loads.csv"].decode())))
    for row in rows:
        row["force_n"] = repr(by(float(row["force_n"])))
    text = io.StringIO(newline="")
    written = csv.DictWriter(text, rows[0])
    written.writeheader()
    written.writerows(rows)
    toml = re.sub(r"(?m)^\[scale\]\n", f"[scale]\n{stated}\n", FILES["campaign.toml"].decode())
    changed = FILES | {"loads.csv": text.getvalue().encode(), "campaign.toml": toml.encode()}
    case = ingested(in_memory(changed))
    return case.loads["force_n"].to_numpy(float), case.settings


def test_the_force_is_what_the_certificate_makes_of_the_reading():
    """A scale that shows 28.9 N with nothing on it, and 1.8 % too much for the rest."""
    as_pulled, settings = shown(lambda force: force)
    found, stated = shown(lambda force: 28.9 + 1.018 * force, "zero_n = 28.9\ngain = 1.018")

    np.testing.assert_allclose(found, as_pulled, rtol=1e-12)
    assert not scale_findings(settings)
    (sentence,) = scale_findings(stated)
    assert "28.9 N" in sentence
    assert "1.018" in sentence


def test_a_zero_beyond_every_reading_leaves_nothing():
    with pytest.raises(InputError, match="zero_n"):
        shown(lambda force: force, "zero_n = 9000")
