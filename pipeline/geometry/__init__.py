"""Where a robot stands, by the unloaded reflectors of a campaign of pulls.

`unloaded.py` has the rows: frame, tool, DH parameters and the weight of the arm (`arm_weight.py`).
`roughness.py` tells gross errors of parameters from their usual ones, `remastered.py` and
`slipped.py` what changed in mid-campaign. Absolute positions are `pipeline/positions/`.
"""
