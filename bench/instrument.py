"""A program that writes files as a tracker and a scale do; started by bench/live.py.

    python -m bench.instrument FOLDER

Each line of its input is a JSON object: `file`, the new `text`, and `how`: `append` or `rewrite`,
which writes the whole file again. It stops in the middle of the last line, prints `half`, continues
when it receives an empty line, and prints `whole`.
"""

import json
import sys
from pathlib import Path


def main(folder: Path) -> None:
    """Write what is requested until the input ends."""
    for line in sys.stdin:
        asked = json.loads(line)
        path, text = folder / asked["file"], asked["text"]
        whole = asked["how"] == "rewrite"
        old = path.read_text() if whole else ""
        with path.open("w" if whole else "a") as export:
            cut = len(text) - 9 if not whole else len(old + text) // 2
            export.write((old + text)[:cut])
            export.flush()
            print("half", flush=True)  # the answer on stdout
            sys.stdin.readline()
            export.write((old + text)[cut:])
        print("whole", flush=True)  # the answer on stdout


if __name__ == "__main__":
    main(Path(sys.argv[1]))
