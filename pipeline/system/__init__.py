"""The linear system c = B x + G e: rows, errors, solution, and further effects in it.

Read `system.py` (the record), `assemble.py` (B, and G by source of error), `whiten.py`,
`estimate.py` (the solution), `fit.py` (the joint springs of a campaign with its noise). The size of
the noise is found in `contrasts.py` and `variance.py`, its shape in `noise_shape.py` from
`beam.py`, `family.py` (tails) and `wander.py`. What further columns would explain is asked in
`linearised.py`, `whitened.py` and `score_tests.py`, by the levels of `alarms.py`.
"""
