"""Outbuilding: what a campaign holds, what is wrong with it, what to type next.

It reads a campaign as `run` does and computes nothing. It names the line of campaign.toml that the
readings contradict (`wrong_lines.py`, `export_words.py`), and says what the files prove by
themselves while the robot still stands there (`proven.py`).

Door: `check.command:check`.
Tests: `tests/check/`.
"""
