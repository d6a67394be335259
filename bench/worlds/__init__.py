"""Worlds outside of the simulator: noise, blunders, loads, payloads and instruments.

The machine is the league's chain of matrices; the timetable, the noise, the blunders and the
files are made here. Nothing shares a formula with the code under test.
"""
