"""Absolute positions: kinematic parameters, compliances under the arm's own weight, joint laws."""
