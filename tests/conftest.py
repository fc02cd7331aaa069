"""For all tests: one thread of arithmetic a process, because pytest-xdist runs as many processes as there are cores."""

import os

# Before numpy and torch are imported, and for the processes that tests start.
for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
