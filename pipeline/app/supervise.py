"""`python -m pipeline.app.supervise COMMAND`: runs COMMAND until whoever started this is gone.

The parent holds the other end of stdin and never writes; the end of file is the end of the parent,
even of one that was killed and could tell nobody.
"""

import subprocess
import sys
import threading


def main() -> int:
    """Run the command; its exit code."""
    process = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
    threading.Thread(target=_follow, args=[process], daemon=True).start()
    return process.wait()


def _follow(process: "subprocess.Popen[bytes]") -> None:
    sys.stdin.buffer.read()
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()


if __name__ == "__main__":
    sys.exit(main())
