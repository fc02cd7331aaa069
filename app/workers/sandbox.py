"""The walls around a worker: resource limits everywhere, and on Linux a list of the system calls it may make.

A worker talks over one socket that it has, and computes. It opens nothing: no file, no connection, no process. All of
what it needs is loaded before the walls go up. None of this needs a privilege, and all of it holds as root too.
"""

import contextlib
import ctypes
import os
import platform
import resource
import struct
import sys

_PR_SET_SECCOMP, _PR_SET_NO_NEW_PRIVS = 22, 38
_MODE_FILTER = 2
_ALLOW, _KILL, _EPERM = 0x7FFF0000, 0x80000000, 0x00050001
_LOAD, _IF_EQUAL, _RETURN = 0x20, 0x15, 0x06
_OPEN_FILES = 16

# Architecture of the audit interface; calls that are always allowed; `tgkill` and `prlimit64`, which are allowed on
# the worker itself. In this order: read write readv writev pread64 close fstat lseek dup fcntl poll-like, memory,
# signals, time and scheduling, identity, messages on a socket that is there, threads' bookkeeping, the end.
_X86_64 = (
    0xC000003E,
    (
        0,
        1,
        19,
        20,
        17,
        3,
        5,
        8,
        32,
        72,
        7,
        23,
        270,
        271,
        232,
        9,
        10,
        11,
        12,
        25,
        27,
        28,
        239,
        13,
        14,
        15,
        131,
        219,
        24,
        35,
        96,
        98,
        100,
        201,
        204,
        228,
        229,
        230,
        309,
        143,
        145,
        39,
        102,
        107,
        110,
        186,
        63,
        99,
        318,
        44,
        45,
        46,
        47,
        202,
        218,
        273,
        324,
        334,
        60,
        231,
    ),
    (234, 302),
)
_ARM64 = (
    0xC00000B7,
    (
        63,
        64,
        65,
        66,
        67,
        57,
        80,
        62,
        23,
        25,
        72,
        73,
        222,
        226,
        215,
        214,
        216,
        232,
        233,
        236,
        134,
        135,
        139,
        132,
        128,
        124,
        101,
        169,
        165,
        153,
        123,
        113,
        114,
        115,
        168,
        120,
        121,
        172,
        174,
        175,
        173,
        178,
        160,
        179,
        278,
        206,
        207,
        211,
        212,
        98,
        96,
        99,
        283,
        293,
        93,
        94,
    ),
    (131, 261),
)
_TABLES = {"x86_64": _X86_64, "aarch64": _ARM64}


def available() -> bool:
    """Whether system calls can be filtered here."""
    return sys.platform == "linux" and platform.machine() in _TABLES and sys.maxsize > 2**32


def limit_resources(memory_bytes: int) -> None:
    """From now on: so much address space beyond what is in use, few descriptors, no writing to files, no core dump."""
    with contextlib.suppress(OSError, ValueError):  # another system may not know a limit
        _set(resource.RLIMIT_AS, _address_space() + memory_bytes)
    _set(resource.RLIMIT_NOFILE, _OPEN_FILES)
    _set(resource.RLIMIT_FSIZE, 0)
    _set(resource.RLIMIT_CORE, 0)


def limit_cpu(seconds: float) -> None:
    """The process is ended when it has computed for ``seconds`` more, rounded up: the guard behind the deadline."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    end = int(used.ru_utime + used.ru_stime + seconds) + 2
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CPU, (end if hard < 0 else min(end, hard), hard))


def be_killed_first() -> None:
    """Where memory runs out, the kernel shall end a worker and not the server."""
    with contextlib.suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
        file.write("1000")


def filter_system_calls() -> None:
    """Refuse, with EPERM, whatever is not on the list: opening files, sockets, processes, signals to others.

    Raises:
        OSError: the kernel does not allow filters.
    """
    program = _program(os.getpid())
    libc = ctypes.CDLL(None, use_errno=True)
    code = ctypes.create_string_buffer(program)
    # struct sock_fprog: the number of instructions, padding, where they are
    head = ctypes.create_string_buffer(struct.pack("HxxxxxxQ", len(program) // 8, ctypes.addressof(code)))
    if libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) or libc.prctl(_PR_SET_SECCOMP, _MODE_FILTER, head, 0, 0):
        raise OSError(ctypes.get_errno(), "the kernel refuses a filter for system calls")


def _program(pid: int) -> bytes:
    """The filter, in the kernel's classic packet-filter code over struct seccomp_data."""
    arch, always, on_itself = _TABLES[platform.machine()]
    steps = [(_LOAD, 0, 0, 4), (_IF_EQUAL, 1, 0, arch), (_RETURN, 0, 0, _KILL), (_LOAD, 0, 0, 0)]
    for number in always:
        steps += [(_IF_EQUAL, 0, 1, number), (_RETURN, 0, 0, _ALLOW)]
    for number in on_itself:
        # Another call: go on behind this block. This one: its first argument must be 0 or the worker's own id.
        steps += [(_IF_EQUAL, 0, 5, number), (_LOAD, 0, 0, 16)]
        steps += [(_IF_EQUAL, 1, 0, 0), (_IF_EQUAL, 0, 1, pid), (_RETURN, 0, 0, _ALLOW), (_RETURN, 0, 0, _EPERM)]
    steps.append((_RETURN, 0, 0, _EPERM))
    return b"".join(struct.pack("HBBI", *step) for step in steps)


def _set(limit: int, value: int) -> None:
    _, hard = resource.getrlimit(limit)
    value = value if hard < 0 else min(value, hard)
    resource.setrlimit(limit, (value, value))


def _address_space() -> int:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[0]) * resource.getpagesize()
