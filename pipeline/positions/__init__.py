"""Outbuilding: campaigns of absolute positions, alone or beside pulls of the same robot.

A run asks for it where campaign.toml has [positions]: they are screened (`position_rows.py`,
`position_readings.py`), identified (`study.py`, in the order of `campaign.py`) and judged
(`facts.py`), make an answer (`answer.py`), or say where the robot of the pulls stands
(`with_pulls.py`), and one answer is made of both (`both.py`, `combined.py`). What is estimated is a
`mechanism.py`: kinematic parameters, springs under the arm's own weight (`yielding.py`), laws of
joints (`laws.py`) and their curves (`random_curve.py`).

Door: `campaign:identify_positions` and `campaign:conclude`; `both:PositionsAndPulls`; for
`pipeline check` `checked:of_positions`.
Tests: `tests/positions/`, and those of the estimate in `tests/geometry/`.
"""
