"""Outbuilding: what follows the first page of a report, sections and figures with their texts.

The core's report has the certificate, the causes and the stiffnesses. What an engineer consults
when a number is in doubt is here: the cell in three dimensions, residuals, budget, registration,
DH parameters, method, rivals, laws, cross-validation, and maps of the workspace.

Door: `sections:SECTIONS`, `figures:PLOTS`; for the tables that only these need,
`pictured:pictured` and `pictured:of_positions`.
Tests: `tests/report/`, for whole pages.
"""
