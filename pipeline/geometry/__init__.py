"""Where a robot stands: kinematic parameters, compliances under its own weight, laws of joints.

`mechanism.py` has them all, with springs under weight (`yielding.py`), laws (`laws.py`) and curves
(`random_curve.py`). `unloaded.py` estimates the table from the unloaded reflectors of a campaign of
pulls; campaigns of absolute positions are estimated in `pipeline/positions/study.py`.
"""
