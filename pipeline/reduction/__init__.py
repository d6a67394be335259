"""From the files of a campaign to forces and displacements in F_b.

`ingest.py` reads the files into the tables of a `case.py`, by campaign.toml (`settings.py`);
`bring.py` is the order from there: registration, displacements and forces, and all of them as
arrays with their errors (`measured.py`).
"""
