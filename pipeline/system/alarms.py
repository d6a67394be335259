"""False alarms: how often chance may accuse a clean campaign, test by test and in all.

Every test that can call a clean campaign anything but `adequate` takes its rate from here, so that
what all of them together may do is one sum. The rate of a family of tests (all suspects, all
readings) holds for the family, not for each member. There is one budget, which the pulls and the
positions of one campaign share: every rate is a part of it, and the parts are no more than the
whole (`TOGETHER`).
"""

from __future__ import annotations

MOST = 0.01
"""What all tests of one campaign together may reach, be it of pulls, of positions or of both: one
clean campaign in a hundred, also where a thousand are counted [1]."""

SUSPECT = 0.20 * MOST
"""Probability that any suspect of the catalogue is found beside the joint springs [1]."""

PLANNED = SUSPECT / 70
"""The same of one suspect where a campaign is planned: a measured one finds its own threshold
(`detect.threshold`), that of some 70 independent tests with the catalogue of a robot on a rail."""

LACK_OF_FIT = 0.025 * MOST
"""The same of each of the two tests of lack of fit, by poses and by pulls [1]."""

READING = 0.02 * MOST
"""The same of each family of readings: of poses, of whole poses, of the base, of whole base
reflectors, of the chain, of the scale, of those with equal digits, and of readings in use that are
too many too far off [1]."""

LADDERS = READING / 100
"""The same of all forces of two poses that stand in each other's place [1]; of an exchange that is
none likelihoods say so even more rarely, as they bound it for any."""

EXCHANGED = READING / 10 - LADDERS
"""The same of rows of the loads that stand in each other's place: a part of the rate of the scale,
whose readings they are, since chance has to make two of them fit each other by 3 % and more [1]."""

SCALE = READING - EXCHANGED - LADDERS
"""What is left of it for a single reading of the scale [1]."""

FRAME = 0.01 * MOST
"""The same of another frame of the stated covariances [1]."""

MOVED = 1e-9
"""The same of an instrument that stood elsewhere from some pose of a series on, or was knocked
between two rounds of base reflectors [1]. Copies of what the likeliest move leaves reach a quarter
less than readings without any, of which 2 in 150 had p < 1e-3 and the least had 1e-6; a move by the
noise of one reading has 1e-9 to 1e-7, twice that 1e-26."""

DRIFT = 0.05 * MOST - MOVED
"""The same of a motion of the tracker that the base reflectors show [1]."""

MISFIT = 0.04 * MOST
"""The same of what the model leaves, by chi-square with the noise stated or found [1]: a fit less
probable than this is never called adequate."""

SCATTER = 0.05 * MOST
"""The same of a scatter beyond `TOLERATED` times the stated one [1]; it is no fault of the model,
and the joint springs stay."""

LAW = 0.10 * MOST
"""The same of a law that nobody listed, in displacements or in positions [1]."""

GEOMETRY = 0.05 * MOST
"""The same of one cause among all that unloaded readings are asked for, and of a rough table
[1]."""

LOOSE = 0.01 * MOST - MOVED
"""The same of targets that only seem to move against each other under load [1]."""

COMPONENT = 0.003
"""The same of each component of the noise that repeats show to be larger than stated [1]; it
changes weights and uncertainties only."""

ACCUSING = {
    "a cause": SUSPECT,
    "lack of fit by poses": LACK_OF_FIT,
    "lack of fit by pulls": LACK_OF_FIT,
    "a reading of a pose": READING,
    "a reading of the base": READING,
    "a base reflector": READING,
    "a reading of the chain": READING,
    "a reading of the scale": SCALE,
    "exchanged rows of the scale": EXCHANGED,
    "exchanged forces of two poses": LADDERS,
    "a pose that moved": READING,
    "a reading that repeats another": READING,
    "another frame of covariances": FRAME,
    "a tracker that moved": DRIFT,
    "a tracker that was knocked": MOVED,
    "too many readings far off": READING,
    "a misfit": MISFIT,
    "a larger scatter": SCATTER,
    "a law that nobody listed": LAW,
    "a wrong table": GEOMETRY,
    "loose targets": LOOSE,
}
"""Every test that can take `adequate` away from a campaign of pulls, with its rate."""

OF_POSITIONS = {
    "a reading off": READING,
    "a law that nobody listed": LAW,
    "a wrong table": GEOMETRY,
    "an instrument that stood elsewhere": MOVED,
}
"""The same of a campaign of positions."""

TOGETHER = {
    **ACCUSING,
    **{f"{what}, of positions": rate for what, rate in OF_POSITIONS.items()},
    "springs that disagree": MISFIT,
    "tables that disagree": GEOMETRY,
}
"""The same of a campaign of both, the most that is ever asked of one: the whole budget."""
