"""Outbuilding: robot and answer in the file formats of other programs.

A robot file made from a URDF; of a finished campaign results.xlsx and csv/ for spreadsheets, and
the identified springs for simulators (URDF, MJCF, SDF). Without it a campaign still has its report,
result.json and model.toml.

Door: `exchange.files:files`, which `run` asks; `exchange.command:robot`.
Tests: `tests/exchange/`.
"""
