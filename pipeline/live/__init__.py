"""Outbuilding: a campaign that is judged while the robot still stands there.

A folder that grows is looked at; whenever whole lines have come, what is there is identified as
`pipeline run` would, so that the last update is the run of the finished campaign.

Door: `live.command:live`, behind `pipeline watch --live`.
Tests: `tests/live/`; bench/live.py feeds campaigns reading by reading.
"""
