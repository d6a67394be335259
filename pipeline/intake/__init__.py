"""Outbuilding: recognise files of unknown form; propose and ask, never guess.

Door: `intake.command` for the command line (`init`, `inspect`); for the readers `intake.proposal`,
which describes a table of no dialect, and `intake.by_reflectors`, which settles ambiguities of an
export by reflectors with known positions.
Tests: `tests/intake/`; random_tables.py draws what strangers may send.
"""
