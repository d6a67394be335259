"""The certified values, in 50-digit arithmetic and from formulas of its own; imports no pipeline.

`kinematics` has the robot, `campaign` reads the files, `answers` solves, `make` drew the data.
"""
