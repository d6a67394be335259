"""The certified values, in 50-digit arithmetic and from independent formulas, without the pipeline.

`kinematics` has the robot, `campaign` reads the files, `answers` solves, `make` drew the data.
"""
