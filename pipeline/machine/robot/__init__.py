"""Robots: from a table of DH parameters to the vectorised kinematics of many poses."""

from pipeline.machine.robot.configuration import Configuration, configure
from pipeline.machine.robot.mdh import SHIPPED, Joint, Robot, load

__all__ = ["SHIPPED", "Configuration", "Joint", "Robot", "configure", "load"]
