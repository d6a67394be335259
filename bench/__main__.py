"""`python -m bench [NAME ...]`: all benchmarks, or those named, one line per figure."""

import importlib
import pkgutil
import sys

import bench


def main() -> None:
    """Run each bench_*.py and print its rows as they are computed."""
    names = [m.name for m in pkgutil.iter_modules(bench.__path__) if m.name.startswith("bench_")]
    asked = sys.argv[1:] or [name.removeprefix("bench_") for name in names]
    unknown = sorted(set(asked) - {name.removeprefix("bench_") for name in names})
    if unknown:
        sys.exit(f"no benchmark {', '.join(unknown)}; there are {', '.join(names)}")
    for name in asked:
        print(f"\n{name}", flush=True)
        for what, figure, comment in importlib.import_module(f"bench.bench_{name}").run():
            print(f"  {what:58} {figure:10.4g}   {comment}", flush=True)


if __name__ == "__main__":
    main()
