"""Table of the commands; each is imported when it is called, and only parses, calls and prints."""

from __future__ import annotations

from typing import NamedTuple


class _Command(NamedTuple):
    """A command: the door of its function, and its line in `--help`."""

    door: str
    line: str


COMMANDS = {
    "init": _Command(
        "pipeline.intake.command:init",
        "Set up a campaign: write its campaign.toml.",
    ),
    "check": _Command(
        "pipeline.check.command:check",
        "Check a campaign: what would be used, and what looks wrong.",
    ),
    "inspect": _Command(
        "pipeline.intake.command:inspect",
        "Describe a tracker export or a log, and what is wrong with it.",
    ),
    "run": _Command(
        "pipeline.app.commands.campaigns:run",
        "Process new or changed campaigns and write their reports.",
    ),
    "status": _Command(
        "pipeline.fleet.command:status",
        "List the campaigns: new, changed or done, with their verdicts.",
    ),
    "report": _Command(
        "pipeline.app.commands.campaigns:report",
        "Open or print a report, or the overview of all campaigns.",
    ),
    "compare": _Command(
        "pipeline.fleet.command:compare",
        "Compare two campaigns, or two models of one campaign.",
    ),
    "remove": _Command(
        "pipeline.fleet.command:remove",
        "Take a campaign out of all pages; its measurements are kept aside.",
    ),
    "compensate": _Command(
        "pipeline.programs.command:compensate",
        "Correct a path or a robot program for the deflection under load.",
    ),
    "design": _Command(
        "pipeline.design.command:design",
        "Choose the poses to measure, with a measurement sheet.",
    ),
    "predict": _Command(
        "pipeline.programs.predict:predict",
        "Predict the positions of targets at given joint values.",
    ),
    "query": _Command(
        "pipeline.fleet.command:query",
        "Query all finished campaigns in SQL.",
    ),
    "priors": _Command(
        "pipeline.fleet.command:priors",
        "Estimate from all campaigns how common and how large causes are.",
    ),
    "robot": _Command(
        "pipeline.exchange.command:robot",
        "List robots, show one, or make a robot file from a URDF.",
    ),
    "simulate": _Command(
        "pipeline.simulate.command:simulate",
        "Simulate the raw files of a campaign.",
    ),
    "effects": _Command(
        "pipeline.simulate.command:effects",
        "List the causes of misfit that the diagnosis knows.",
    ),
    "page": _Command(
        "pipeline.page.command:page",
        "Bring a campaign from its files to the report in a browser.",
    ),
    "serve": _Command(
        "pipeline.service.command:serve",
        "Process campaigns as they arrive, with Prefect's dashboard.",
    ),
    "watch": _Command(
        "pipeline.service.command:watch",
        "Process campaigns as they arrive, without Prefect.",
    ),
    "deploy": _Command(
        "pipeline.service.command:deploy",
        "Schedule the scan for new campaigns on a Prefect server.",
    ),
    "doctor": _Command(
        "pipeline.service.command:doctor",
        "Check this machine: what is missing, and how to install it.",
    ),
}
"""The commands in the order of `--help`; those of outbuildings that are not installed are not
offered."""
