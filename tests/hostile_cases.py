"""Cases that do not end, for the limits of the fuzzer; without imports they start at once."""

import os
import signal
import time


def row(number, to):
    """Cases that do not end: 0 is normal, 1 sleeps, 2 dies, 3 ignores signals, 4 uses up memory."""
    if number == 1:
        time.sleep(60)
    if number == 2:
        os._exit(9)
    if number == 3:
        signal.setitimer(signal.ITIMER_REAL, 0)
        time.sleep(60)
    if number == 4:
        return {"outcome": "same", "size": len(bytearray(7 * 2**30))}
    return {"outcome": "same"}
