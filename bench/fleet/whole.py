"""`python -m bench.fleet.whole FOLDER`: whole campaigns of a small fleet, raw files to the report.

The machines are those of the league, which share nothing with the project's own model: three robots
measured every half year, one of them with wear in joint 4.
"""

from __future__ import annotations

import sys
from datetime import date, timedelta
from pathlib import Path

import numpy as np

from bench.fleet.world import WEAR, YEAR
from bench.league.hidden_effect import NOMINAL
from bench.league.play import Rules, drawn, play
from pipeline.app.shell import run_all
from pipeline.machine.robot import load

BEGIN = date(2026, 3, 2)
SEED = 20261123
ROBOTS, CAMPAIGNS, WORN = 3, 5, 3
SCATTER = 0.01


def write(root: Path) -> None:
    """Write the raw folders of all campaigns."""
    robot = load("kr500_rail")
    for number, rng in enumerate(np.random.default_rng(SEED).spawn(ROBOTS)):
        new = 1 / NOMINAL * rng.uniform(0.9, 1.1, robot.n)
        plan = drawn(robot, rng, Rules())
        for k in range(CAMPAIGNS):
            day = BEGIN + timedelta(days=round(YEAR / 2 * k) + 10 * number)
            left = np.ones(robot.n)
            left[WORN] = (1 - WEAR) ** (k / 2) if number == 0 else 1.0
            now = new * left * rng.lognormal(0, SCATTER, robot.n)
            game = play(robot, plan, [], np.random.default_rng([SEED, number, k]), stiffness=now)
            _raw(root / "data" / "raw" / f"cell{number + 1}-{day:%Y-%m}", game.files, day, number)


def _raw(folder: Path, files: dict[str, bytes], day: date, number: int) -> None:
    """Write one folder, with its day and the robot's serial number."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        said = content.replace(b"2026-11-03", day.isoformat().encode())
        if name == "campaign.toml":
            said += f'[robot_unit]\nserial = "{number + 101}"\n'.encode()
        (folder / name).write_bytes(said)


def main() -> None:
    """Write the campaigns, run them, and print the first line of each outcome."""
    root = Path(sys.argv[1])
    write(root)
    for outcome in run_all(root, [], "local", force=False):
        sys.stdout.write(f"{outcome.text.splitlines()[0]}\n")


if __name__ == "__main__":
    main()
