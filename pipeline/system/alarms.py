"""False-alarm rates: how often chance may give a clean campaign a finding, per test and in total.

Every test that can call a clean campaign anything but `adequate` takes its rate from here, so that
the total is one sum. The rate of a family of tests (all suspects, all readings) holds for the
family, not for each member. There is one budget, shared by the pulls and the positions of one
campaign: every rate is a fraction of it, and together they do not exceed it (`OF_BOTH`).
"""

from __future__ import annotations

MOST_ALARMS = 0.01
"""Upper limit of the false-alarm rate of all tests of one campaign together, whether of pulls, of
positions or of both [1]: one clean campaign in a hundred, also where a thousand are counted."""

SUSPECT = 0.20 * MOST_ALARMS
"""False-alarm rate of finding any suspect of the catalogue in addition to the joint springs [1]."""

PLANNED = SUSPECT / 70
"""False-alarm rate of one suspect when a campaign is planned [1]: that of some 70 independent tests
with the catalogue of a robot on a rail. A measured campaign finds its own threshold
(`detect.threshold`)."""

LACK_OF_FIT = 0.025 * MOST_ALARMS
"""False-alarm rate of each of the two tests of lack of fit, by poses and by pulls [1]."""

READING = 0.02 * MOST_ALARMS
"""False-alarm rate of each family of tests on readings [1]: single readings of poses, whole poses,
base readings, whole base reflectors, the chain, the scale, readings with equal digits, and too many
outliers among the readings in use."""

LADDERS = READING / 100
"""False-alarm rate of all forces of two poses being exchanged [1]; the likelihood ratio of an
exchange that did not happen exceeds its limit even more rarely, since that limit bounds the rate
for any alternative."""

EXCHANGED = READING / 10 - LADDERS
"""False-alarm rate of exchanged rows of the loads [1]: with `LADDERS` a tenth of the rate of the
scale, whose readings they are, since by chance two rows would have to fit each other's force where
these differ by 3 % or more."""

SCALE = READING - EXCHANGED - LADDERS
"""False-alarm rate that remains for single readings of the scale and its zero in groups of them,
one family [1]."""

FRAME = 0.01 * MOST_ALARMS
"""False-alarm rate of stated covariances being given in another frame [1]."""

MOVED = 1e-9
"""False-alarm rate of an instrument that stood elsewhere from some pose of a series on, or was
knocked between two rounds of base reflectors [1]. Copies drawn from the residuals of the likeliest
move reach a test value a quarter smaller than readings without a move, of which 2 in 150 had
p < 1e-3 and the smallest p was 1e-6; a move by the noise of one reading has p of 1e-9 to 1e-7,
twice that 1e-26."""

DRIFT = 0.05 * MOST_ALARMS - MOVED
"""False-alarm rate of a motion of the tracker that the base reflectors show [1]."""

GREW = 0.01 * MOST_ALARMS
"""False-alarm rate of a base frame that grew between its rounds [1]."""

MISFIT = 0.032 * MOST_ALARMS
"""False-alarm rate of the chi-square test of the residuals with the noise stated or found [1]: a
fit less probable than this is never called adequate."""

SCATTER = 0.05 * MOST_ALARMS
"""False-alarm rate of a scatter beyond `TOLERATED` times the stated one [1]; this is no fault of
the model, and the joint springs are kept."""

LAW = 0.10 * MOST_ALARMS
"""False-alarm rate of a law that is not in the catalogue, in displacements or in positions [1]."""

STRUCTURE = 0.01 * MOST_ALARMS
"""False-alarm rate of any such law in displacements standing out of the scatter alone [1]: not
certain as a law, since flipped signs of poses may give it, too, but more than noise."""

GEOMETRY = 0.05 * MOST_ALARMS
"""False-alarm rate of one cause among all that unloaded readings are tested for, and of DH
parameters with larger errors than usual throughout [1]."""

ERRING = 0.01 * MOST_ALARMS
"""False-alarm rate of a joint that errs from pose to pose by more than usual, where no cause was
found [1]."""

LOOSE = 0.01 * MOST_ALARMS - MOVED
"""False-alarm rate of targets that seem to move against each other under load [1]."""

TOOL_POINT = 0.005 * MOST_ALARMS
"""False-alarm rate of any point of [tool] being farther off than its stated uncertainty
explains [1]."""

COMPONENT = 0.003
"""False-alarm rate of each noise component that repeats show to be larger than stated [1]; it
changes weights and uncertainties only."""

OF_PULLS = {
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
    "a base frame that grew": GREW,
    "too many readings far off": READING,
    "a misfit": MISFIT,
    "a larger scatter": SCATTER,
    "a law that nobody listed": LAW,
    "structure of no certain law": STRUCTURE,
    "a wrong table": GEOMETRY,
    "loose targets": LOOSE,
    "a wrong point of the tool": TOOL_POINT,
}
"""Every test that can cost a campaign of pulls the verdict `adequate`, with its rate."""

OF_POSITIONS = {
    "a reading off": READING,
    "a law that nobody listed": LAW,
    "a wrong table": GEOMETRY,
    "an instrument that stood elsewhere": MOVED,
    "a joint that errs from pose to pose": ERRING,
}
"""Every such test of a campaign of positions, with its rate."""

OF_BOTH = {
    **OF_PULLS,
    **{f"{what}, of positions": rate for what, rate in OF_POSITIONS.items()},
    "springs that disagree": MISFIT,
    "tables that disagree": GEOMETRY,
}
"""Every such test of a campaign of both, the largest set that is ever applied to one campaign: the
whole budget."""
