"""The version of this package, below all that states it."""

__version__ = "0.1.0"
