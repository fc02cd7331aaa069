"""The sandbox of a worker: resource limits everywhere, and on Linux a list of the system calls it may make.

A worker communicates over the one socket it was given, and computes. It opens nothing: no file, no connection, no
process. All it needs is loaded before. None of this needs a privilege, and all of it holds as root too.
"""

import contextlib
import ctypes
import os
import platform
import resource
import struct
import sys
from collections.abc import Sequence

_PR_SET_SECCOMP, _PR_SET_NO_NEW_PRIVS = 22, 38
_MODE_FILTER = 2
_ALLOW, _KILL, _EPERM = 0x7FFF0000, 0x80000000, 0x00050001
_LOAD, _IF_EQUAL, _IF_ANY_BIT, _RETURN = 0x20, 0x15, 0x45, 0x06
# Where struct seccomp_data has the call's number, the architecture, and the lower halves of its arguments.
_NUMBER, _ARCHITECTURE, _FIRST, _SECOND, _THIRD, _UPPER = 0, 4, 16, 24, 32, 4
_MORE_FILES = 2

# Calls that are always allowed, with their numbers on x86-64 and ARM64 (-: not there); then those on the worker itself.
_ALWAYS = """
read 0 63, write 1 64, readv 19 65, writev 20 66, pread64 17 67, close 3 57, fstat 5 80, lseek 8 62, dup 32 23,
poll 7 -, ppoll 271 73, select 23 -, pselect6 270 72, epoll_wait 232 -,
mmap 9 222, mprotect 10 226, munmap 11 215, brk 12 214, mremap 25 216, mincore 27 232,
get_mempolicy 239 236,
rt_sigaction 13 134, rt_sigprocmask 14 135, rt_sigreturn 15 139, sigaltstack 131 132, restart_syscall 219 128,
sched_yield 24 124, getcpu 309 168,
nanosleep 35 101, clock_nanosleep 230 115, clock_gettime 228 113, clock_getres 229 114, gettimeofday 96 169,
time 201 -, times 100 153, getrusage 98 165,
getpid 39 172, getppid 110 173, gettid 186 178, getuid 102 174, geteuid 107 175, uname 63 160, sysinfo 99 179,
getrandom 318 278,
sendto 44 206, recvfrom 45 207, sendmsg 46 211, recvmsg 47 212,
futex 202 98, set_tid_address 218 96, set_robust_list 273 99, rseq 334 293,
exit 60 93, exit_group 231 94
"""
_ON_ITSELF = """
tgkill 234 131, sched_getaffinity 204 123, sched_getparam 143 121, sched_getscheduler 145 120
"""
# Commands of fcntl: duplicate, read and set flags. None that names a process to be sent signals, or locks, or leases;
# and no flag that has signals sent (O_ASYNC).
_FCNTL = "fcntl 72 25"
_FCNTL_COMMANDS = (0, 1, 2, 3, 1030)
_F_SETFL, _O_ASYNC = 4, 0x2000
# Advice on memory: what allocators give (not needed, free, huge pages or none), and copies ahead. None that reaches
# pages others share: as root one can have them taken out of use.
_MADVISE = "madvise 28 233"
_ADVICE = (4, 8, 14, 15, 23)
# Its own limit on processor time may be set, before each job; others only read: who may do more could take them off.
_LIMITS = "prlimit64 302 261"
# Place in the tables, and name for the kernel's audit interface.
_ARCHITECTURES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}


def _numbers(table: str, column: int) -> list[int]:
    rows = [entry.split()[1:] for entry in table.split(",")]
    return [int(row[column]) for row in rows if row[column] != "-"]


def available() -> bool:
    """Whether system calls can be filtered here."""
    return sys.platform == "linux" and platform.machine() in _ARCHITECTURES and sys.maxsize > 2**32


def limit_resources(memory_bytes: int, *, strict: bool = False) -> None:
    """From now on: so much address space beyond what is in use, few descriptors, no writing to files, no core dump.

    Raises:
        OSError: ``strict``, and not every limit can be set (``/proc`` is missing, say).
    """
    with contextlib.nullcontext() if strict else contextlib.suppress(OSError, ValueError):
        _set(resource.RLIMIT_AS, _address_space() + memory_bytes)
    with contextlib.nullcontext() if strict else contextlib.suppress(OSError):
        # The limit is on a descriptor's number. What is open stays open, and a job brings one more.
        _set(resource.RLIMIT_NOFILE, max(map(int, os.listdir("/proc/self/fd"))) + _MORE_FILES)
    _set(resource.RLIMIT_FSIZE, 0)
    _set(resource.RLIMIT_CORE, 0)


def limit_cpu(seconds: float) -> None:
    """The process is ended when it has computed for ``seconds`` more, rounded up: the guard behind the deadline."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    end = int(used.ru_utime + used.ru_stime + seconds) + 2
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CPU, (end if hard < 0 else min(end, hard), hard))


def raise_oom_score() -> None:
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
    column, arch = _ARCHITECTURES[platform.machine()]
    steps = [(_LOAD, 0, 0, _ARCHITECTURE), (_IF_EQUAL, 1, 0, arch), (_RETURN, 0, 0, _KILL), (_LOAD, 0, 0, _NUMBER)]
    for number in _numbers(_ALWAYS, column):
        steps += [(_IF_EQUAL, 0, 1, number), (_RETURN, 0, 0, _ALLOW)]
    for number in _numbers(_ON_ITSELF, column):
        # Another call: go on behind this block. This one: its first argument must be 0 or the worker's own id.
        steps += [(_IF_EQUAL, 0, 5, number), (_LOAD, 0, 0, _FIRST)]
        steps += [(_IF_EQUAL, 1, 0, 0), (_IF_EQUAL, 0, 1, pid), (_RETURN, 0, 0, _ALLOW), (_RETURN, 0, 0, _EPERM)]
    (number,) = _numbers(_LIMITS, column)
    limits = [
        *[(_LOAD, 0, 0, _FIRST), (_IF_EQUAL, 2, 0, 0), (_IF_EQUAL, 1, 0, pid), (_RETURN, 0, 0, _EPERM)],
        *[(_LOAD, 0, 0, _SECOND), (_IF_EQUAL, 0, 1, resource.RLIMIT_CPU), (_RETURN, 0, 0, _ALLOW)],
        # a pointer to new limits, in two halves
        *[(_LOAD, 0, 0, _THIRD), (_IF_EQUAL, 0, 3, 0), (_LOAD, 0, 0, _THIRD + _UPPER), (_IF_EQUAL, 0, 1, 0)],
        *[(_RETURN, 0, 0, _ALLOW), (_RETURN, 0, 0, _EPERM)],
    ]
    steps += [(_IF_EQUAL, 0, len(limits), number), *limits]
    (number,) = _numbers(_MADVISE, column)
    advice = [*_allowed(_ADVICE), (_RETURN, 0, 0, _EPERM)]
    steps += [(_IF_EQUAL, 0, 1 + len(advice), number), (_LOAD, 0, 0, _THIRD), *advice]
    (number,) = _numbers(_FCNTL, column)
    commands = _allowed(_FCNTL_COMMANDS)
    flags = [(_IF_EQUAL, 0, 3, _F_SETFL), (_LOAD, 0, 0, _THIRD), (_IF_ANY_BIT, 1, 0, _O_ASYNC), (_RETURN, 0, 0, _ALLOW)]
    steps += [(_IF_EQUAL, 0, 1 + len(commands) + len(flags), number), (_LOAD, 0, 0, _SECOND), *commands, *flags]
    steps.append((_RETURN, 0, 0, _EPERM))
    return b"".join(struct.pack("HBBI", *step) for step in steps)


def _allowed(values: Sequence[int]) -> list[tuple[int, int, int, int]]:
    """Steps that allow the call if what was loaded is one of these."""
    return [step for value in values for step in ((_IF_EQUAL, 0, 1, value), (_RETURN, 0, 0, _ALLOW))]


def _set(limit: int, value: int) -> None:
    _, hard = resource.getrlimit(limit)
    value = value if hard < 0 else min(value, hard)
    resource.setrlimit(limit, (value, value))


def _address_space() -> int:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[0]) * resource.getpagesize()
