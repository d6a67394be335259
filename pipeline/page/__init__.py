"""Outbuilding: `pipeline page`, from files to the report in a browser, without a terminal.

Five pages of a campaign (files, setup, check, run, answer) at an address of this machine. Each
shows what `init`, `inspect`, `check`, `run` and `compensate` print as JSON, which run as separate
processes (`jobs.py`), and edits campaign.toml line by line (`entries.py`); there is no rule here
that a command does not have. `desk.py` is the folder of a campaign, `drawing.py` the cell as a
picture, `server.py` the pages.

Door: `page.command:page`.
Tests: `tests/page/`, with whole campaigns in Chromium.
"""
