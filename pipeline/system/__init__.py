"""c = B x + G e: its rows, its errors, its solution, and what else may be in it."""
