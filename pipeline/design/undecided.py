"""Open questions of a diagnosis, and the poses that would decide them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base.errors import InputError
from pipeline.design.nextpose import Candidates, PlaceQuestion, candidates, determine, propose
from pipeline.diagnosis.cause_search import SearchResult, SearchTask
from pipeline.diagnosis.diagnose import LEAST_OF_RIVALS
from pipeline.diagnosis.facts import CrossValidation, Determining, FoundCause, SeparatingPose
from pipeline.diagnosis.isolability import Twins
from pipeline.diagnosis.verdict import CERTAIN

_MOST = 4
"""Maximum number of rivals of one cause that are considered, the likeliest."""


def to_measure(
    task: SearchTask,
    found: SearchResult,
    causes: tuple[FoundCause, ...],
    worth: CrossValidation | None,
    known: Twins,
    rng: np.random.Generator,
) -> tuple[tuple[SeparatingPose, ...], tuple[Determining, ...]]:
    """Poses that would separate causes; where there are none, those that determine joints."""
    proposed = next_poses(task, found, causes, worth, known, rng)
    joints = () if proposed else _determining(task, found, rng.spawn(1)[0])
    return proposed, joints


def next_poses(
    task: SearchTask,
    found: SearchResult,
    causes: Sequence[FoundCause],
    worth: CrossValidation | None,
    known: Twins,
    rng: np.random.Generator,
) -> tuple[SeparatingPose, ...]:
    """Poses that would decide the open questions, as far as any can."""
    questions = _open(found, causes, worth, known)
    among = _reachable(task, rng) if questions else None
    return () if among is None else tuple(propose(found.wide, questions, among))


def _determining(
    task: SearchTask, found: SearchResult, rng: np.random.Generator
) -> tuple[Determining, ...]:
    """For each joint the pose that would determine it best; empty where no pose is reachable."""
    among = _reachable(task, rng)
    return () if among is None else determine(found.wide, among)


def _reachable(task: SearchTask, rng: np.random.Generator) -> Candidates | None:
    """Candidate poses; None where the cell leaves none."""
    try:
        among = candidates(task, rng)
    except InputError:
        return None
    return among if len(among.anchor) else None


def _open(
    found: SearchResult, causes: Sequence[FoundCause], worth: CrossValidation | None, known: Twins
) -> list[PlaceQuestion]:
    """For each accepted cause that is not certain, what it must still be separated from.

    Twins count as one: no pull helps, a sensor does (`needs` of the causes). Where every name is
    certain and only the gain is not, it must be separated from the joint springs alone.
    """
    questions = [
        PlaceQuestion(tuple(odds), tuple(odds.values()), _others(found, mine))
        for place, mine in enumerate(found.accepted)
        if len(odds := _standing_there(found, place, causes[place], known)) > 1
    ]
    if questions or worth is None or worth.ci95[0] > 0:
        return questions
    return [
        PlaceQuestion((mine, None), (0.5, 0.5), _others(found, mine))
        for mine, cause in zip(found.accepted, causes, strict=False)
        if not cause.twins
    ]


def _others(found: SearchResult, mine: int) -> tuple[int, ...]:
    return tuple(i for i in found.accepted if i != mine)


def _standing_there(
    found: SearchResult, place: int, cause: FoundCause, known: Twins
) -> dict[int | None, float]:
    """Possible causes in one place, with their odds; a single one where that is certain."""
    one = (cause.effect.label, *known.of(cause.effect.label))
    mine = [r.probability for r in found.rivals[place] if r.label in one]
    odds: dict[int | None, float] = {found.accepted[place]: sum(mine)}
    if cause.probability < CERTAIN:
        others = [r for r in found.rivals[place] if r.label not in one]
        odds |= {
            r.suspect: r.probability for r in others[:_MOST] if r.probability > LEAST_OF_RIVALS
        }
    if found.strange and found.strange[place].probability > 1 - CERTAIN:
        strange = found.strange[place]
        odds = {who: (1 - strange.probability) * odd for who, odd in odds.items()}
        odds[strange.suspect] = strange.probability
    return odds
