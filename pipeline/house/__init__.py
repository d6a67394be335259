"""Outbuilding: a house's own certificate, from a folder of overrides that pipeline.toml names.

Its `house.toml` has a logo, additional lines and an order of the annexes. A line is text with names
of facts in double braces: it cannot call, loop, read a file or write HTML, and values from a
campaign are inserted unchanged.

The texts of certificate and sheet in other languages are here as well (`catalogue.py`).

Door: `looks`; `catalogue:translator`.
Tests: `tests/house/`.
"""

from pipeline.house.appearances import looks
from pipeline.house.folder import House, house

__all__ = ["House", "house", "looks"]
