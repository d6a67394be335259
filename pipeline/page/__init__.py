"""`pipeline page`: from files to the report in a browser, without a terminal.

Five pages of a campaign (files, setup, check, run, answer) at an address of this machine.

Door: `command.page`. Each page shows what `init`, `inspect`, `check`, `run` and `compensate` print
as JSON, which run as separate processes, and edits campaign.toml line by line; there is no rule
here that a command does not have. Of the core it imports `base` and `machine` only.

Tests: `tests/page/`: the text of campaign.toml (entries), files and archives (desk), commands
(jobs), doors and stages of the server, and whole campaigns in Chromium.

`entries.py` is campaign.toml as fields; `desk.py` the folder of a campaign; `jobs.py` commands that
run; `drawing.py` the cell as a picture; `server.py` the pages.
"""
