"""What the model gets wrong: detect, name, extend, measure the gain, ask for the next pose."""
