"""The version of this package, below all that states it."""

__version__ = "1.0.0"
