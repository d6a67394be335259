"""Outbuilding: all robots over all their campaigns; tables, wear, alarms, questions, priors.

Door: `fleet.command` for the command line, `fleet.pages` for who has run a campaign: `refresh`
brings the page over all of them up to date, `together` is what one page says of the others.
Tests: `tests/fleet/`; bench/fleet plays careers.
"""
