"""Outbuilding: judge a campaign while it is measured, with the robot still at hand.

A growing folder is watched; whenever complete lines have arrived, the data so far are identified as
by `pipeline run`, so that the last update agrees with the run of the finished campaign.

Door: `live.command:live`, behind `pipeline watch --live`.
Tests: `tests/live/`; bench/live.py feeds campaigns reading by reading.
"""
