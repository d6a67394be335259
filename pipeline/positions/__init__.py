"""Outbuilding: campaigns of absolute positions, alone or beside pulls of the same robot.

A run asks for it where campaign.toml has [positions]: they are screened and identified
(`campaign.py`), make an answer (`answer.py`), or say where the robot of the pulls stands, and one
answer is made of both (`both.py`).

Door: `campaign:identify_positions` and `campaign:conclude`; `both:PositionsAndPulls`.
Tests: `tests/positions/`, and those of the estimate in `tests/geometry/`.
"""
