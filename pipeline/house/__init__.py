"""Outbuilding: a house's own certificate, from a folder of overrides that pipeline.toml names.

Its `house.toml` has a logo, own lines and an order of the annexes. A line is text with names of
facts in double braces: nothing of it can call, loop, read a file or write HTML, and what a campaign
says is put in as it is.

Door: `house`.
Tests: `tests/house/`.
"""

from pipeline.house.folder import House, house

__all__ = ["House", "house"]
