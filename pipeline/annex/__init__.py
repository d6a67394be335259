"""Outbuilding: what stands behind the first page of a report, parts and figures with their words.

The report has its certificate, the causes, the stiffnesses and the cell itself; what an engineer
looks at when a number is doubted stands here: residuals, budget, registration, the robot's table,
the method, rivals, laws, cross-validation, where the robot was and what it would do elsewhere.

Door: `sections:SECTIONS`, `figures:PLOTS`; for the tables they alone need `pictured:pictured`.
Tests: `tests/report/`, for whole pages.
"""
