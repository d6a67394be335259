"""Forward model of the machine: robot, elastic effects, cell and instrument."""
