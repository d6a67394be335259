"""`python -m bench.picture`: diagram of the packages of pipeline/, each above its imports.

It is drawn from the code's own imports, without those implied by others. The outbuildings, which
the core does not need, stand to the right.
"""

from __future__ import annotations

import ast
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

PACKAGE = Path(__file__).parents[1] / "pipeline"
PICTURE = PACKAGE.parent / "docs/figures/packages.svg"


def outbuildings() -> list[str]:
    """Packages whose first page names a door."""
    pages = sorted(PACKAGE.glob("*/__init__.py"))
    return [one.parent.name for one in pages if "\nDoor: " in one.read_text("utf-8")]


def packages() -> dict[str, set[str]]:
    """Imports of each package, or file at the top, from the others."""
    out: dict[str, set[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        mine = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if mine.startswith("__"):
            continue
        found = out.setdefault(mine, set())
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pipeline"):
                words = f"{node.module}.{node.names[0].name}".split(".")
                found.add(words[1])
    return {name: (uses & set(out)) - {name} for name, uses in out.items()}


def floors(uses: dict[str, set[str]]) -> dict[str, int]:
    """Length of the longest chain of imports from each package."""

    def floor(name: str) -> int:
        return 1 + max((floor(other) for other in uses[name]), default=-1)

    return {name: floor(name) for name in uses}


def reduced(uses: dict[str, set[str]]) -> dict[str, set[str]]:
    """Imports that are not implied by a chain of others."""

    def below(name: str) -> set[str]:
        return uses[name].union(*(below(other) for other in uses[name]))

    return {
        name: {one for one in mine if not any(one in below(other) for other in mine - {one})}
        for name, mine in uses.items()
    }


def lines_of(name: str) -> int:
    """Number of lines of a package's code."""
    here = PACKAGE / name
    files = here.rglob("*.py") if here.is_dir() else [here.with_suffix(".py")]
    return sum(len(path.read_text("utf-8").splitlines()) for path in files)


def main(file: Path) -> None:
    """Draw the diagram into an SVG file."""
    matplotlib.rcParams["svg.hashsalt"] = "packages"
    matplotlib.rcParams["svg.fonttype"] = "none"
    everything, beside = packages(), outbuildings()
    uses = {name: mine for name, mine in everything.items() if name not in beside}
    height = floors(uses)
    rows = [sorted(n for n in uses if height[n] == k) for k in range(max(height.values()) + 1)]
    at = {
        name: ((k + 0.5 - len(row) / 2) * 2.4, height[name])
        for row in rows
        for k, name in enumerate(row)
    }
    right = max(x for x, _ in at.values()) + 3.0
    heights = np.linspace(len(rows) - 1, 0, len(beside))  # all within the picture
    at |= {name: (right, float(y)) for name, y in zip(beside, heights, strict=True)}
    canvas = Figure(figsize=(7, 0.62 * len(rows)))
    axes = canvas.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    for name, mine in sorted(reduced(uses).items()):
        for other in sorted(mine):
            axes.annotate(
                "", at[other], at[name], arrowprops={"arrowstyle": "->", "color": "0.6", "lw": 0.9}
            )
    for name, (x, y) in at.items():
        words = f"{name}  {lines_of(name)}"
        box = {
            "boxstyle": "round,pad=0.35",
            "facecolor": "0.93" if name in beside else "white",
            "edgecolor": "0.3",
        }
        axes.text(x, y, words, ha="center", va="center", fontsize=9, bbox=box)
    axes.set_xlim(min(x for x, _ in at.values()) - 1.6, right + 1.6)
    axes.set_ylim(-0.6, len(rows) - 0.4)
    canvas.savefig(file, metadata={"Date": None})


if __name__ == "__main__":
    main(PICTURE)
