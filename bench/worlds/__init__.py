"""Worlds beyond the simulator: noise, blunders, loads, payloads and instruments.

The machine is the league's chain of matrices; timetable, noise, blunders and files are made here.
Nothing shares a formula with the code under test.
"""
