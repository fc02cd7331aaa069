"""Settings come from the environment, and only sensible ones pass."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from app import settings
from app.settings import Settings, available_cores


def test_environment_is_read_with_the_prefix(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRSNET_PORT", "9123")
    monkeypatch.setenv("PORT", "1")
    assert Settings().port == 9123
    assert Settings(port=9124).port == 9124


@pytest.mark.parametrize(
    ("name", "value"),
    [("WORKERS", "0"), ("QUEUE", "-1"), ("DEADLINE_S", "0"), ("PORT", "70000"), ("LOG_LEVEL", "x")],
)
def test_senseless_values_are_refused(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(f"PRSNET_{name}", value)
    with pytest.raises(ValidationError):
        Settings()


def test_summary_names_every_setting() -> None:
    summary = Settings(host="0.0.0.0").summary()
    assert "host=0.0.0.0" in summary
    assert all(f"{name}=" in summary for name in Settings.model_fields)


@pytest.mark.parametrize(
    ("quota", "cores"),
    [("150000 100000", 1), ("300000 100000", 3), ("50000 100000", 1), ("max 100000", 4), ("", 4)],
)
def test_cores_respect_the_containers_quota(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, quota: str, cores: int
) -> None:
    (tmp_path / "cpu.max").write_text(quota)
    monkeypatch.setattr(settings, "_CGROUP_QUOTA", tmp_path / "cpu.max")
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(4)))
    assert available_cores() == cores
