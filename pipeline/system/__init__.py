"""The linear system c = B x + G e: rows, errors, solution, and further effects in it."""
