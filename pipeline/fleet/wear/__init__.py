"""How the stiffnesses of a robot change over its campaigns, and what the fleet adds to that."""
