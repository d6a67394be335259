"""Outbuilding: all robots over all their campaigns; states, tables, wear, queries, priors.

Door: `fleet.command` for the command line; `fleet.pages` for runs of campaigns: `refresh` updates
the page over all campaigns, `among` is what one page states about the others; `history:since`, what
changed since the campaign before.
Tests: `tests/fleet/`; bench/fleet simulates robots over their service life.
"""
