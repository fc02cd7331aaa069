"""Everything that can be configured, in one typed class.

Each field is read from the environment variable of the same name with the prefix ``PRSNET_``, as in
``PRSNET_PORT=9000``. Nothing else in the application reads the environment.
"""

import os
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, SecretStr, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

_CGROUP_QUOTA = Path("/sys/fs/cgroup/cpu.max")
_CGROUP_MEMORY = Path("/sys/fs/cgroup/memory.max")
# The same in the first version of cgroups.
_V1_QUOTA, _V1_PERIOD = (Path(f"/sys/fs/cgroup/cpu/cpu.cfs_{part}_us") for part in ("quota", "period"))
_V1_MEMORY = Path("/sys/fs/cgroup/memory/memory.limit_in_bytes")
_WORKER_MEMORY = 2 << 30


def available_cores() -> int:
    """Cores this process may use: its CPU affinity, cut to the container's CPU quota when there is one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota = _words(_CGROUP_QUOTA) or [*_words(_V1_QUOTA), *_words(_V1_PERIOD)]
    # "max", and -1 in the first version: no quota
    if len(quota) == 2 and quota[0].isdigit() and quota[1].isdigit():
        cores = min(cores, max(1, int(quota[0]) // max(int(quota[1]), 1)))
    return cores


def memory_per_worker() -> int:
    """2 GiB, or in a container with a memory limit an equal share of three quarters of it, if that is less."""
    limit = _words(_CGROUP_MEMORY) or _words(_V1_MEMORY)
    if not limit or not limit[0].isdigit():  # no cgroup, or "max": no limit
        return _WORKER_MEMORY
    return max(min(_WORKER_MEMORY, int(limit[0]) * 3 // 4 // available_cores()), 256 << 20)


def _words(path: Path) -> list[str]:
    """What a file of the kernel says; nothing where there is none."""
    try:
        return path.read_text().split()
    except OSError:
        return []


def _split(keys: SecretStr) -> list[str]:
    return list(filter(None, (key.strip() for key in keys.get_secret_value().split(","))))


class UnknownSettingsError(ValueError):
    """Variables of the environment have the prefix and are no settings: a name with a typo is a limit not set."""


def settings_of_environment(**given: Any) -> "Settings":
    """The environment's settings, and before them what is given: those of a program as people start it.

    Raises:
        UnknownSettingsError: a variable with the prefix is no setting.
        pydantic.ValidationError: a value makes no sense.
    """
    if unknown := _unknown_variables():
        raise UnknownSettingsError(f"There are no such settings: {', '.join(unknown)}.")
    return Settings(**given)


def _unknown_variables() -> list[str]:
    return sorted(
        name
        for name in os.environ
        if name.upper().startswith("PRSNET_") and name.upper()[7:].lower() not in Settings.model_fields
    )


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
    places_per_client: int | None = Field(
        default=None,
        ge=1,
        description="Requests of one client (one key, or without keys one address) with workers or waiting for them "
        "(default: three quarters of all there may be).",
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
    uploads: int = Field(
        default=64, ge=1, le=10_000, description="Uploads received at a time; one more gets 503, or a slow one 408."
    )
    uploads_per_address: int = Field(default=32, ge=1, description="Uploads received at a time from one address.")
    upload_bytes_per_s: int = Field(
        default=4096, ge=1, description="Bytes a second an upload must bring on average, after `stall_s`."
    )
    spool_bytes: int = Field(
        default=1024 * 1024, ge=0, description="Uploads above this size are kept on disk, not in memory."
    )
    spool_dir: str | None = Field(
        default=None,
        description="Folder for them (default: the system's, as in TMPDIR), or `memory`: sealed files in memory.",
    )
    max_answer_bytes: int = Field(
        default=128 * 1024 * 1024, ge=1024, le=2**31, description="Largest mesh sent back; more is answered with 413."
    )
    sending_bytes: int = Field(
        default=512 * 1024 * 1024, ge=1024, description="Bytes of meshes on their way to clients; beyond, one gets 503."
    )
    cache_bytes: int = Field(
        default=64 * 1024 * 1024,
        ge=0,
        description="Answers kept for files that are sent again, in bytes; 0 keeps none and sends no ETag.",
    )
    max_connections: int = Field(
        default=1000, ge=1, description="Connections kept open; for one more the longest idle one is closed."
    )
    connections_per_address: int = Field(
        default=500, ge=0, description="Connections kept open of one address (0: no limit)."
    )
    client_address_header: str = Field(
        default="",
        pattern=r"[A-Za-z0-9-]*",
        description="Header in which a trusted proxy names the client, such as X-Forwarded-For: its last entry counts.",
    )
    worker_memory_bytes: int = Field(
        default_factory=memory_per_worker,
        ge=64 * 1024 * 1024,
        description="Address space a job may use beyond what is loaded (default: 2 GiB, less in a small container).",
    )
    worker_jobs: int = Field(
        default=1000, ge=1, description="Jobs after which a worker is replaced by a fresh one at the latest."
    )
    isolation: Literal["none", "client", "request"] = Field(
        default="client",
        description="What a worker serves before it is replaced: any requests, those of one client (one key, or "
        "without keys one address), or a single one.",
    )
    renew_s: float = Field(
        default=600.0,
        ge=0,
        description="Seconds after which workers that replace others are forked from a new process, with other "
        "addresses (0: only after one has crashed or lied).",
    )
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
    log_format: Literal["auto", "json", "text"] = Field(
        default="auto", description="`json`: an object a line; `text`: for people; `auto`: text on a terminal."
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(default="info", description="Least level logged.")

    @field_validator("api_keys")
    @classmethod
    def _are_keys(cls, value: SecretStr) -> SecretStr:
        if value.get_secret_value() and not _split(value):
            raise ValueError("it holds no key; leave it out to serve everybody")
        return value

    @field_validator("spool_dir")
    @classmethod
    def _is_a_folder(cls, value: str | None) -> str | None:
        if value == "memory" and hasattr(os, "memfd_create"):
            return value
        if value is not None and not (os.path.isdir(value) and os.access(value, os.W_OK | os.X_OK)):
            raise ValueError("there is no such folder, or it cannot be written to")
        return value

    @property
    def keys(self) -> list[str]:
        """The keys, one by one."""
        return _split(self.api_keys)

    def summary(self) -> str:
        """All settings on one line, ``name=value``, for the log at start-up (a secret as asterisks)."""
        return " ".join(f"{name}={value}" for name, value in self.model_dump().items())
