"""Other ways to the same answer, as entries of the open league.

They get c, B, the covariance of c and the catalogue's columns from our reduction, so that what
differs is the estimation; how they estimate is their own, numpy and scipy only.
"""
