"""The answer: result.json as defined by its contract, result tables, and their sentences.

A campaign of positions is carried out here (`of_positions.py`), a campaign of pulls in `run.py`.
"""
