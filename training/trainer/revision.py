"""Which code a run was trained with."""

import subprocess
from pathlib import Path


def git_revision() -> str:
    """The checked-out commit, `-dirty` behind it when tracked files differ; "unknown" outside a repository."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--abbrev=40", "--dirty"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
