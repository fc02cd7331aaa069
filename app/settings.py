"""Everything that can be configured, in one typed class.

Each field is read from the environment variable of the same name with the prefix ``PRSNET_``, as in
``PRSNET_PORT=9000``. Nothing else in the application reads the environment.
"""

import os
from pathlib import Path
from typing import Literal

from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

_CGROUP_QUOTA = Path("/sys/fs/cgroup/cpu.max")
_CGROUP_MEMORY = Path("/sys/fs/cgroup/memory.max")
_WORKER_MEMORY = 2 << 30


def available_cores() -> int:
    """Cores this process may use: its CPU affinity, cut to the container's CPU quota when there is one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = _CGROUP_QUOTA.read_text().split()
        cores = min(cores, max(1, int(quota) // int(period)))
    except (OSError, ValueError):  # no cgroup v2, or "max": no quota
        pass
    return cores


def memory_per_worker() -> int:
    """2 GiB, or in a container with a memory limit an equal share of three quarters of it, if that is less."""
    try:
        limit = int(_CGROUP_MEMORY.read_text())
    except (OSError, ValueError):  # no cgroup v2, or "max": no limit
        return _WORKER_MEMORY
    return max(min(_WORKER_MEMORY, limit * 3 // 4 // available_cores()), 256 << 20)


class Settings(BaseSettings):
    """Settings of one server process; see each field's description."""

    model_config = SettingsConfigDict(env_prefix="PRSNET_", frozen=True)

    host: str = Field(default="127.0.0.1", description="Address to listen on.")
    port: int = Field(default=8000, ge=0, le=65535, description="Port to listen on; 0 picks a free one.")
    weights: str = Field(
        default="default",
        description='Weights to serve: "default", "paper", or the path of a .safetensors file.',
    )
    workers: int = Field(
        default_factory=available_cores,
        ge=1,
        le=256,
        description="Meshes worked on at a time (default: one a core).",
    )
    queue: int = Field(
        default=16,
        ge=0,
        le=10_000,
        description="Requests that may wait for a worker; one more is answered with 503.",
    )
    deadline_s: float = Field(
        default=60.0,
        gt=0,
        description="Seconds a request may take from its first byte, upload and waiting included.",
    )
    parse_s: float = Field(default=20.0, gt=0, description="Seconds the reading of a file may take.")
    upload_s: float = Field(default=30.0, gt=0, description="Seconds an upload may take; more is answered with 408.")
    stall_s: float = Field(
        default=10.0, gt=0, description="Seconds an upload may pause, and a request's header may take."
    )
    max_upload_bytes: int = Field(
        default=64 * 1024 * 1024, ge=1024, description="Largest request body; more is answered with 413."
    )
    max_vertices: int = Field(
        default=5_000_000, ge=3, description="Most vertices of a mesh; more is answered with 413."
    )
    max_faces: int = Field(default=5_000_000, ge=1, description="Most faces of a mesh; more is answered with 413.")
    max_nodes: int = Field(default=100_000, ge=1, description="Most nodes, objects and placements of a scene.")
    max_unpacked_bytes: int = Field(
        default=256 * 1024 * 1024, ge=1024, description="Most bytes that a 3MF file may unpack to."
    )
    uploads: int = Field(default=64, ge=1, le=10_000, description="Uploads received at a time; one more gets 503.")
    spool_bytes: int = Field(
        default=1024 * 1024, ge=0, description="Uploads above this size are kept on disk, not in memory."
    )
    spool_dir: str | None = Field(default=None, description="Folder for them (default: the system's, as in TMPDIR).")
    max_answer_bytes: int = Field(
        default=128 * 1024 * 1024, ge=1024, le=2**31, description="Largest mesh sent back; more is answered with 413."
    )
    sending_bytes: int = Field(
        default=512 * 1024 * 1024, ge=1024, description="Bytes of meshes on their way to clients; beyond, one gets 503."
    )
    max_connections: int = Field(default=1000, ge=1, description="Connections kept open; one more is closed at once.")
    worker_memory_bytes: int = Field(
        default_factory=memory_per_worker,
        ge=64 * 1024 * 1024,
        description="Address space a job may use beyond what is loaded (default: 2 GiB, less in a small container).",
    )
    worker_jobs: int = Field(default=1000, ge=1, description="Jobs after which a worker is replaced by a fresh one.")
    worker_nice: int = Field(default=5, ge=0, le=19, description="By how much workers give way to the server itself.")
    sandbox: bool = Field(
        default=True, description="Workers may not open files or connections (Linux on x86-64 and ARM64)."
    )
    drain_s: float = Field(
        default=2.0,
        ge=0,
        le=300,
        description="Seconds from SIGTERM to closing the port: /health says 503, requests are served.",
    )
    keep_alive_s: int = Field(default=15, ge=1, description="Seconds an idle connection is kept open.")
    api_keys: SecretStr = Field(
        default=SecretStr(""), description="Keys that clients must have one of, separated by commas (default: none)."
    )
    cors_origins: str = Field(
        default="", description="Origins whose pages may call the service, separated by commas (default: none)."
    )
    viewer: bool = Field(default=True, description="Whether there is the viewer, at /.")
    docs: bool = Field(default=True, description="Whether there are /docs and /openapi.json.")
    metrics: bool = Field(default=True, description="Whether there is /metrics.")
    otel: bool = Field(default=False, description="Whether to send traces by OTLP (needs the extra `otel`).")
    log_format: Literal["json", "text"] = Field(default="json", description="One JSON object a line, or plain text.")
    log_level: Literal["debug", "info", "warning", "error"] = Field(default="info", description="Least level logged.")

    def summary(self) -> str:
        """All settings on one line, ``name=value``, for the log at start-up (a secret as asterisks)."""
        return " ".join(f"{name}={value}" for name, value in self.model_dump().items())
