"""The figures: each module has words and picture of its own, from the same digest."""
