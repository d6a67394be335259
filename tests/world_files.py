"""Files of one campaign of a world of the bench, with its hidden causes."""

from bench.worlds import run
from bench.worlds.cell import build
from bench.worlds.worlds import WORLDS
from pipeline.machine.robot import load

SEED = 11


def cell_of(name, seed=SEED):
    """The cell of a world, without its hidden causes."""
    world = WORLDS[name]
    robot = load(world.robot)
    return build(robot, world.plan(robot, seed), world.rules, seed)


def written(name, seed=SEED):
    """Cell, records without and with blunders, and the files."""
    world, cell = WORLDS[name], cell_of(name, seed)
    clean, record, factor = run._recorded(cell, world, seed)
    return cell, clean, record, run._files(cell, world, record, factor)
