"""Outbuilding: what `import pipeline` offers, with arguments checked and results in SI.

A campaign identified in this process, and what its model says of other poses: deflections,
positions, Cartesian stiffness, offsets that compensate a path. `pipeline/__init__.py` hands its
names out when they are asked for; other outbuildings come in here, too.

Door: `library.campaign`, `library.model`; for programs `library.compensate`.
Tests: `tests/library/`.
"""
