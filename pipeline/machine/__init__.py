"""Forward model of the machine: robot, elastic effects, cell and instrument.

`cell.py` predicts what the tracker would read of a cell with its effects; `effect.py` says what an
effect may act on, `effects/` lists them; `robot/` is geometry, `instrument.py` the noise.
"""
