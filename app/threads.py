"""One thread of arithmetic a process: there are as many processes as cores."""

ONE_THREAD: dict[str, str] = dict.fromkeys(
    ["OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"], "1"
)
"""Environment in which torch, numpy and numba start no threads of their own; it is read when they are imported."""
