"""Outbuilding: what a stranger's file may be, proposed and asked, never guessed.

Door: `intake.command` for the command line (`init`, `inspect`); for the readers `intake.table`,
which describes a table of no dialect, and `intake.known`, which settles what an export leaves open
by reflectors whose places are known.
Tests: `tests/intake/`; random_tables.py draws what strangers may send.
"""
