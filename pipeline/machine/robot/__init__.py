"""Robots: from a table of DH parameters to the kinematics of many poses at once."""

from pipeline.machine.robot.configuration import Configuration, configure
from pipeline.machine.robot.mdh import CONVENTIONS, SHIPPED, Joint, Robot, load

__all__ = ["CONVENTIONS", "SHIPPED", "Configuration", "Joint", "Robot", "configure", "load"]
