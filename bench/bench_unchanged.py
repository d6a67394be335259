"""Cost of an unchanged campaign: CPU time in `status` and in `run`."""

import json
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from bench.bench_jobs import project
from pipeline.app.shell import run_all
from pipeline.fleet.states import states
from pipeline.run import run as run_one
from pipeline.store.campaign import MANIFEST, CampaignFolder, every

COUNTS = (1, 10, 100)
WAYS: dict[str, Callable[[Path], list[object]]] = {
    "status": lambda root: list(states(root)),
    "run": lambda root: list(run_all(root, [], "local", False)),
}


def run() -> Iterator[tuple[str, float, str]]:
    """Time per further campaign [ms], with the total for each number of campaigns."""
    took: dict[str, list[float]] = {way: [] for way in WAYS}
    for count in COUNTS:
        with project(count) as root:
            finish(root)
            for way, work in WAYS.items():
                took[way].append(_least_ms(work, root, count))
    for way, all_ms in took.items():
        slope = (all_ms[-1] - all_ms[0]) / (COUNTS[-1] - COUNTS[0])
        said = ", ".join(f"{ms:.1f} ms for {n}" for n, ms in zip(COUNTS, all_ms, strict=True))
        yield f"{way}, one more unchanged campaign [ms]", slope, said


def finish(root: Path) -> None:
    """Finish every copy of one campaign, of which only the first is computed."""
    first, *others = every(root)
    run_one(first)
    noted = json.loads((first.processed / MANIFEST).read_text("utf-8"))
    for one in others:
        for mine, its in ((first.processed, one.processed), (first.reports, one.reports)):
            shutil.copytree(mine, its, dirs_exist_ok=True)
        outputs = {_renamed(path, first, one): digest for path, digest in noted["outputs"].items()}
        content = noted | {"source": one.source, "outputs": outputs}
        (one.processed / MANIFEST).write_text(json.dumps(content), "utf-8")
    list(run_all(root, [], "local", False))  # page and tables over all campaigns


def _renamed(path: str, first: CampaignFolder, one: CampaignFolder) -> str:
    return path.replace(f"/{first.name}/", f"/{one.name}/")


def _least_ms(work: Callable[[Path], list[object]], root: Path, count: int) -> float:
    times = []
    for _ in range(3):
        began = time.process_time()
        made = work(root)
        times.append(1e3 * (time.process_time() - began))
        assert len(made) == count
    return min(times)
