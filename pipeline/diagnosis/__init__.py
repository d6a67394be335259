"""Diagnosis: detect what the model lacks, name it, extend the model, and propose further poses.

`converge.py` iterates over mistakes, noise and causes, and calls `diagnose.py`: unloaded reflectors
(`unloaded_geometry.py`) and base reflectors (`drift.py`), the search (`cause_search.py`, then laws
in `unlisted.py`), rivals as `hypotheses.py`, what they improve (`gain.py`), and what could not have
been seen (`blindspots.py`). All of it ends in `facts.py`, from which alone `verdict.py` reads the
verdict (docs/verdict.md). Positions come to the same facts in their outbuilding.
"""
