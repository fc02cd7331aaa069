"""Runs a command and tells what it and all its descendants used: core-seconds, and the most memory at a time.

    python benchmarks/core_seconds.py COMMAND...

Root on Linux: it makes control groups, which also count processes that were started in the background or reparented.
Unlike wall-clock time, core-seconds hardly depend on what else the machine does.
"""

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path("/sys/fs/cgroup")


def groups() -> tuple[Path, Path]:
    """New groups for time and memory: one and the same in version 2."""
    name = f"core-seconds-{os.getpid()}"
    version_1 = (ROOT / "cpuacct").is_dir()
    pair = (ROOT / "cpuacct" / name, ROOT / "memory" / name) if version_1 else (ROOT / name, ROOT / name)
    for path in pair:
        path.mkdir(exist_ok=True)
    return pair


def used(cpu: Path, memory: Path) -> tuple[float, float]:
    """Core-seconds and peak GB."""
    if (cpu / "cpuacct.usage").exists():
        peak = int((memory / "memory.max_usage_in_bytes").read_text())
        return int((cpu / "cpuacct.usage").read_text()) / 1e9, peak / 1e9
    usage = dict(line.split() for line in (cpu / "cpu.stat").read_text().splitlines())
    return int(usage["usage_usec"]) / 1e6, int((memory / "memory.peak").read_text()) / 1e9


def main() -> int:
    """Run it; the exit code is the command's."""
    cpu, memory = groups()

    def enter() -> None:
        for path in {cpu, memory}:
            (path / "cgroup.procs").write_text(str(os.getpid()))

    began = time.perf_counter()
    code = subprocess.run(sys.argv[1:], preexec_fn=enter, check=False).returncode
    seconds, peak = used(cpu, memory)
    elapsed = time.perf_counter() - began
    print(
        f"{seconds:.1f} core-seconds in {elapsed:.1f} s, at most {peak:.2f} GB (file cache included)", file=sys.stderr
    )
    for path in {cpu, memory}:
        with contextlib.suppress(OSError):  # something is still there
            path.rmdir()
    return code


if __name__ == "__main__":
    sys.exit(main())
