"""Outbuilding: the figures behind the first page of a report, each in a file with its words.

The report draws its certificate, the stiffnesses and the cell itself; what an engineer looks at
when a number is doubted stands here: residuals, rivals, laws, cross-validation, where the robot was
and what it would do elsewhere. Without this folder a report has its tables and sentences.

Door: `figures:PLOTS`; for the tables that they alone need `pictured:pictured`.
Tests: `tests/report/`, for whole pages.
"""
