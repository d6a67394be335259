"""Outbuilding: which poses to measure, with plan file and measurement sheet.

Door: `design.command:design` for the command line, `design.library` for `import pipeline`.
Tests: `tests/design/`; what is promised is measured by bench/bench_design.py.
"""
