"""Bugs planted at random in one room of the package, and whether the tests of that room fail.

A bug is one changed operator, number, condition, argument or index of one function, drawn from a
seed. It is played by the fast tests of the room that enter the function, be it while their file is
imported, in a fixture, or when a cache was filled. A bug that nothing notices is shown as a line of
source before and after: either a test is missing, or the line does nothing, or both lines mean the
same.
"""
