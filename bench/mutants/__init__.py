"""Bugs planted at random in one room of the package, and whether the tests of that room fail.

A bug is one changed operator, number, condition, argument or index of one function, drawn from a
seed. It is played by the fast tests of the room that enter the function; what these let pass is
played once more by all of them. A bug that nothing notices is shown as a line of source before and
after: either a test is missing, or the line does nothing, or both lines mean the same.
"""
