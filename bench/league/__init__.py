"""Hidden-effect league: machines with a secret, raw files, and a judge who opens both.

Nothing here shares a formula with the catalogue. The machine is a chain of homogeneous matrices
with finite rotations, its laws are piecewise or have a memory, and some of its secrets are in no
catalogue.
"""
