"""Where the robot stands: absolute positions, its table, springs under its own weight, and laws."""
