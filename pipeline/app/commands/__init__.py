"""Table of the commands; each is imported when it is called, and only parses, calls and prints."""

from __future__ import annotations

from typing import NamedTuple


class _Command(NamedTuple):
    """A command: the door of its function, and its line in `--help`."""

    door: str
    line: str


_ROWS = (
    ("init", "intake", "Set up a campaign: write its campaign.toml."),
    ("check", "check", "Check a campaign: what would be used, and what looks wrong."),
    ("inspect", "intake", "Describe a tracker export or a log, and what is wrong with it."),
    ("run", "app", "Process new or changed campaigns and write their reports."),
    ("status", "fleet", "List the campaigns: new, changed or done, with their verdicts."),
    ("report", "app", "Open or print a report, or the overview of all campaigns."),
    ("compare", "fleet", "Compare two campaigns, or two models of one campaign."),
    ("remove", "fleet", "Take a campaign out of all pages; its measurements are kept aside."),
    ("compensate", "programs", "Correct a path or a robot program for the deflection under load."),
    ("design", "design", "Choose the poses to measure, with a measurement sheet."),
    ("predict", "programs", "Predict the positions of targets at given joint values."),
    ("query", "fleet", "Query all finished campaigns in SQL."),
    ("priors", "fleet", "Estimate from all campaigns how common and how large causes are."),
    ("robot", "exchange", "List robots, show one, or make a robot file from a URDF."),
    ("simulate", "simulate", "Simulate the raw files of a campaign."),
    ("effects", "simulate", "List the causes of misfit that the diagnosis knows."),
    ("page", "page", "Bring a campaign from its files to the report in a browser."),
    ("serve", "service", "Process campaigns as they arrive, with Prefect's dashboard."),
    ("watch", "service", "Process campaigns as they arrive, without Prefect."),
    ("deploy", "service", "Schedule the scan for new campaigns on a Prefect server."),
    ("doctor", "service", "Check this machine: what is missing, and how to install it."),
)
"""Name, folder and help of each command; its function, of that name, is in the folder's module
`command`."""

COMMANDS = {name: _Command(f"pipeline.{room}.command:{name}", line) for name, room, line in _ROWS}
"""The commands in the order of `--help`; those of outbuildings that are not installed are not
offered."""
