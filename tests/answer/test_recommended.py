"""Whose values the answer gives: one test for every row of the decision."""

from itertools import product

import pytest

from pipeline.answer.contract import Data, Reason, Which
from pipeline.answer.recommended import TABLE, DecisionBasis, decide

SPRINGS, EXTENDED, AVERAGED = Which.JOINT_SPRINGS, Which.EXTENDED, Which.AVERAGED
GIVEN, CORRECTED = Data.AS_GIVEN, Data.CORRECTED


@pytest.mark.parametrize(
    ("mistakes", "verdict", "modelled", "rivals", "model", "data", "reason"),
    [
        (False, "adequate", False, False, SPRINGS, GIVEN, Reason.ADEQUATE),
        (False, "unexplained", False, False, SPRINGS, GIVEN, Reason.UNEXPLAINED),
        (False, "unexplained", True, True, SPRINGS, GIVEN, Reason.UNEXPLAINED),
        (False, "explained", True, False, EXTENDED, GIVEN, Reason.CAUSE_IDENTIFIED),
        (False, "explained", True, True, AVERAGED, GIVEN, Reason.CAUSE_AND_RIVALS),
        (False, "explained", False, False, SPRINGS, GIVEN, Reason.SPRINGS_UNTOUCHED),
        (False, "ambiguous", True, False, EXTENDED, GIVEN, Reason.CAUSE_DOUBTFUL),
        (False, "ambiguous", True, True, AVERAGED, GIVEN, Reason.RIVALS),
        (False, "ambiguous", False, False, SPRINGS, GIVEN, Reason.SPRINGS_UNTOUCHED),
        (True, "adequate", False, False, SPRINGS, CORRECTED, Reason.MISTAKE),
        (True, "explained", False, False, SPRINGS, CORRECTED, Reason.MISTAKE_SPRINGS_UNTOUCHED),
        (True, "ambiguous", False, False, SPRINGS, CORRECTED, Reason.MISTAKE_SPRINGS_UNTOUCHED),
        (True, "explained", True, False, EXTENDED, CORRECTED, Reason.MISTAKE_AND_CAUSE),
        (True, "ambiguous", True, True, AVERAGED, CORRECTED, Reason.MISTAKE_AND_RIVALS),
        (True, "unexplained", True, True, SPRINGS, CORRECTED, Reason.MISTAKE_AND_UNEXPLAINED),
    ],
)
def test_the_values_are_those_of_the_model_that_holds(
    mistakes, verdict, modelled, rivals, model, data, reason
):
    """Model, data and reason follow from mistakes, verdict and what was identified."""
    row = decide(DecisionBasis(mistakes, verdict, modelled, rivals))

    assert (row.model, row.data, row.reason) == (model, data, reason)


def test_what_changes_no_model_only_weighs_the_springs_anew():
    """Where the robot stands was put right, nothing stands beside the springs."""
    row = decide(DecisionBasis(False, "explained", modelled=True, rivals=False, beside=False))

    assert (row.model, row.data, row.reason) == (EXTENDED, GIVEN, Reason.WEIGHED_ANEW)
    row = decide(DecisionBasis(False, "explained", modelled=True, rivals=True, beside=False))
    assert (row.model, row.data, row.reason) == (AVERAGED, GIVEN, Reason.WEIGHED_ANEW)


@pytest.mark.parametrize(
    ("mistakes", "verdict", "model", "reason"),
    [
        (False, "adequate", AVERAGED, Reason.TOO_SMALL),
        (True, "adequate", AVERAGED, Reason.MISTAKE_AND_TOO_SMALL),
        (False, "explained", AVERAGED, Reason.SPRINGS_UNTOUCHED),
        (True, "explained", AVERAGED, Reason.MISTAKE_SPRINGS_UNTOUCHED),
        (False, "unexplained", SPRINGS, Reason.UNEXPLAINED),
        (True, "unexplained", SPRINGS, Reason.MISTAKE_AND_UNEXPLAINED),
    ],
)
def test_what_is_too_small_to_name_counts_where_the_model_holds(mistakes, verdict, model, reason):
    """Springs are averaged over it unless something is missing that no cause explains."""
    row = decide(DecisionBasis(mistakes, verdict, modelled=False, rivals=False, too_small=True))

    assert (row.model, row.reason) == (model, reason)


def test_every_campaign_has_a_row_and_every_row_a_campaign():
    """Whatever the facts, one row decides; and no row stands in the table for nothing."""
    verdicts = ("adequate", "explained", "ambiguous", "unexplained")
    decided = {
        decide(DecisionBasis(mistakes, verdict, modelled, modelled and rivals, *more)).reason
        for mistakes, verdict, modelled, rivals, *more in product(
            (False, True), verdicts, *[(False, True)] * 5
        )
    }

    assert decided == {row.reason for row in TABLE} == set(Reason)
