"""Outbuilding: which poses to measure, with plan file and measurement sheet.

Door: `design.command:design` for the command line, `design.library` for `import pipeline`.
Tests: test_design.py, test_plan.py, test_criteria.py, test_discriminate.py, test_information.py,
test_unpulled.py; what is promised is measured by bench/bench_design.py.
"""
