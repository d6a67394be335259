"""Outbuilding: what `import pipeline` offers, with arguments checked and results in SI.

A campaign identified in this process, and predictions of its model at other poses: deflections,
positions, Cartesian stiffness, offsets that compensate a path. `pipeline/__init__.py` exports its
names lazily; other outbuildings enter here, too.

Door: `library.campaign`, `library.model`; for programs `library.compensate`,
`library.target_model`, `library.holds`; for a run `library.model_file` and
`library.kinematic_model`, which write what is read here.
Tests: `tests/library/`.
"""
