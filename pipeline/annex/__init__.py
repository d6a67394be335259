"""Outbuilding: what follows the first page of a report, sections and figures with their texts.

The core's report is the certificate and the answer in words; its two drawings are made here, and
what an engineer consults when a number is in doubt: stiffnesses, causes and their gain,
cross-validation, the cell in three dimensions, residuals, budget, registration, DH parameters,
method, and maps of the workspace. How readings check each other is computed here, too, as no other
part of an answer depends on it.

Door: `sections:sections`, `figures:PLOTS`, `paper:printed`; for the tables that only these need,
`figure_tables:pictured`, `figure_tables:of_positions` and `position_tables:identified`; for
`reliability` and `influence` of the answer, `reliability:control`; for the draws of its
`validation`, `validate:validated` and `validate:means`.
Tests: `tests/annex/`, and `tests/report/` for whole pages.
"""
