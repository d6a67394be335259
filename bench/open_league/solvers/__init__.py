"""Alternative estimators, as entries of the open league.

They get c, B, the covariance of c and the catalogue's columns from our reduction, so that only the
estimation differs; the estimators are independent of the package and mostly use numpy and scipy
only.
"""
