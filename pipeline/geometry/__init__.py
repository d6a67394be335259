"""Absolute positions: kinematic parameters, compliances under the arm's own weight, joint laws.

`study.py` is the order: readings (`positioned.py`), a start (`initial.py`), the estimate of a
`mechanism.py` (`calibrate.py`), outliers, causes of the catalogue and laws, each with its error at
left-out poses (`left_out.py`). For a campaign of pulls `unloaded.py` asks the same of its unloaded
reflectors, and `with_pulls.py` hands on what the positions of the same robot say.
"""
