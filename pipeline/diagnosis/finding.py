"""Findings of a diagnosis, and the verdicts that they lead to."""

from __future__ import annotations

from enum import StrEnum

WRONG_LAW = 1.6
"""Remainder ratio from which on a law of the model must be wrong [1]."""


class Verdict(StrEnum):
    """Verdict on a campaign, the most severe last."""

    ADEQUATE = "adequate"
    EXPLAINED = "explained"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"
    BAD_DATA = "bad_data"

    @property
    def severity(self) -> int:
        """Rank of severity, 0 to 4."""
        return list(Verdict).index(self)


class Finding(StrEnum):
    """Kinds of findings; each occurs in one row of `TABLE`."""

    MISTAKE = "mistake"
    TRACKER_MOVED = "tracker_moved"
    TRACKER_MOVED_OR_KNOCKED = "tracker_moved_or_knocked"
    TRACKER_KNOCKED = "tracker_knocked"
    BASE_GREW = "base_grew"
    STANDS_ELSEWHERE = "stands_elsewhere"
    STANDS_ELSEWHERE_OR_RIVAL = "stands_elsewhere_or_rival"
    GEOMETRY_REFUTED = "geometry_refuted"
    ROUGH_TABLE = "rough_table"
    STANDS_UNEXPLAINED = "stands_unexplained"
    TABLES_DISAGREE = "tables_disagree"
    REFLECTORS_LOOSE = "reflectors_loose"
    NO_CAUSE_FITS = "no_cause_fits"
    PREDICTS_WORSE = "predicts_worse"
    UNCONFIRMED = "unconfirmed"
    REMAINDER = "remainder"
    OUTSIDE_CATALOGUE = "outside_catalogue"
    GAIN_UNCERTAIN = "gain_uncertain"
    TWO_LAWS = "two_laws"
    RIVALS = "rivals"
    OUTSIDE_CATALOGUE_POSSIBLE = "outside_catalogue_possible"
    SCALE_SCATTERS = "scale_scatters"
    BEYOND_CERTIFICATE = "beyond_certificate"
    OFF_THE_TABLE = "off_the_table"
    MISFIT = "misfit"
    BEYOND_A_TRACKER = "beyond_a_tracker"
    CAUSE_IDENTIFIED = "cause_identified"
    SCATTER = "scatter"
    NOTHING_DETERMINED = "nothing_determined"
    PREDICTS_NOTHING = "predicts_nothing"
    SPRINGS_DISAGREE = "springs_disagree"
    BEYOND_NOISE = "beyond_noise"
    SCATTERED = "scattered"
    NOTHING = "nothing"
