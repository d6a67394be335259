"""Outbuilding: check of a campaign - what it contains, what is wrong, what to type next.

It reads a campaign as `run` does and computes no results. It names the line of campaign.toml that
the readings contradict (`wrong_lines.py`), and reports errors that the files
prove by themselves while the robot is still set up (`proven.py`).

Door: `check.command:check`; `torques:weighed`, payloads by the joints' torques, for the answer.
Tests: `tests/check/`.
"""
