"""The hidden-effect league: machines with a secret, raw files, and a judge who opens both.

Nothing here shares a formula with the catalogue. The machine is a chain of homogeneous matrices
in finite rotations, its laws are piecewise or have a memory, and a part of its secrets is in no
catalogue at all.
"""
