"""Outbuilding: what stands behind the first page of a report, parts and figures with their words.

The report has its certificate, the causes and the stiffnesses itself; what an engineer looks at
when a number is doubted stands here: the cell in three dimensions, residuals, budget, registration,
the robot's table, the method, rivals, laws, cross-validation, what it would do elsewhere.

Door: `sections:SECTIONS`, `figures:PLOTS`; for the tables they alone need `pictured:pictured` and
`pictured:of_positions`.
Tests: `tests/report/`, for whole pages.
"""
