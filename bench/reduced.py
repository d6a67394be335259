"""A campaign up to its displacements in F_b: the first half of a run, for tests and studies."""

from pipeline.reduction.bring import Keep, Reduced, Step, bring, inline
from pipeline.run import ingested
from pipeline.store.campaign import Raw


def reduce(raw: Raw, keep: Keep, step: Step = inline) -> Reduced:
    """The displacements; implausible input, which a run keeps for the faults, is rejected."""
    return bring(ingested(raw, keep, step), keep, step)
