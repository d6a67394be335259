"""The machine and what moves it: robot, elastic effects, cell, instrument."""
