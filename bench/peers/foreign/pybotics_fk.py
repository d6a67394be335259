"""Frames of pybotics at given joint values: python pybotics_fk.py TABLE.csv JOINTS.csv OUT.csv.

Runs in its own environment (pybotics.txt); imports nothing of the project.
"""

import sys

import numpy as np
from pybotics.robot import Robot

table, joints, out = sys.argv[1:]
robot = Robot.from_parameters(np.loadtxt(table, delimiter=","))
rows = [robot.fk(q)[:3].ravel() for q in np.loadtxt(joints, delimiter=",")]
np.savetxt(out, rows, fmt="%.17g", delimiter=",")
