"""What `run --strict` takes for a misfit, and how many rows are told."""

import pytest
import report_sample

from pipeline.answer.contract import Rejected
from pipeline.app.outcome import outcome, sentences
from pipeline.store.campaign import CampaignFolder


@pytest.mark.parametrize(
    ("decision", "misfit"), [("pass", False), ("undecided", True), ("fail", True)]
)
def test_an_undecided_tolerance_is_not_certainly_kept(tmp_path, decision, misfit):
    """Exit code 4 with --strict: "the tolerance is not certainly kept" (README)."""

    def state(content):
        content["diagnosis"]["verdict"] = "adequate"
        content["rejected"] = []
        content["tolerance"] = {"deflection_mm": 0.5, "test_pose": decision, "path": None}
        for joint in content["stiffness"]:
            joint["identifiable"] = True

    answer = report_sample.revised(report_sample.answer(), state)
    done = outcome(CampaignFolder(tmp_path, tmp_path / "a"), lambda _: answer)

    assert done.exit_code == 0
    assert done.misfit is misfit


def test_rows_that_are_not_told_are_counted_as_rows():
    """Three are listed; of nine others, some with equal reasons, nine are left."""
    reasons = [f"target P{k} is not listed; add it" for k in (1, 2, 3, 4)]
    rows = [
        Rejected(file="t.csv", line=k, reason=reason)
        for k, reason in enumerate([*reasons, *reasons, *reasons], 2)
    ]

    assert len(rows) == 12
    assert sentences(rows)[-1] == "t.csv: ... and 9 more lines like this"
