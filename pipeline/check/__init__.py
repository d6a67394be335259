"""Outbuilding: check of a campaign - what it contains, what is wrong, what to type next.

It reads a campaign as `run` does and computes no results. It names the line of campaign.toml that
the readings contradict (`wrong_lines.py`), and reports errors that the files prove by themselves
while the robot is still set up (`proven.py`). An answer asks it which statements the readings
contradict (`contradictions.py`), and what else is odd about the files (`findings.py`). The
screening asks it which anchor of chains without reflectors is elsewhere (`misplaced_anchors.py`).

Door: `check.command:check`; for the answer `contradictions:against_stated`, `findings:findings` and
`torques:weighed`, payloads by the joints' torques; for the screening `misplaced_anchors:misplaced`.
Tests: `tests/check/`.
"""
