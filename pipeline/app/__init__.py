"""Commands, Prefect flow and service.

Linear algebra gets one thread before numpy is there: our matrices are small, so that a second one
only costs time, and with the number of threads the last digits change.
"""

import os

for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
