"""c = B x + G e: its rows, its errors, its solution, and further effects in it."""
