"""Outbuilding: selection of the poses to measure, with plan file and measurement sheet.

Door: `design.command:design` for the command line, `design.library` for `import pipeline`; for the
diagnosis `design.undecided`, the next poses of a campaign that was measured, and
`design.separability`, how far its causes are from each other, and for the answer
`design.parting`, what would separate joints that are determined only together.
Tests: `tests/design/`; what is promised is measured by bench/bench_design.py.
"""
