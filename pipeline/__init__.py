"""Stiffness of every joint of a rail-mounted robot, from pulls that a laser tracker watched."""

__version__ = "0.1.0"
