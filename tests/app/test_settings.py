"""Settings come from the environment, and only sensible ones pass."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from app import settings
from app.http.main import create_app
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


@pytest.mark.parametrize("keys", [" , ,", ",", " "])
def test_keys_that_are_none_do_not_open_the_service(keys: str) -> None:
    with pytest.raises(ValidationError):
        Settings(api_keys=keys)
    assert Settings(api_keys=" a, b,").keys == ["a", "b"]


def test_a_folder_for_uploads_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(ValidationError):
        Settings(spool_dir=str(tmp_path / "missing"))
    assert Settings(spool_dir=str(tmp_path)).spool_dir == str(tmp_path)


def test_names_with_a_typo_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRSNET_PORT", "9123")
    monkeypatch.setenv("PRSNET_API_KEY", "x")
    monkeypatch.setenv("prsnet_max_face", "3")
    with pytest.raises(settings.UnknownSettingsError, match="PRSNET_API_KEY, prsnet_max_face"):
        settings.settings_of_environment()
    with pytest.raises(settings.UnknownSettingsError):  # however the service is started
        create_app()
    monkeypatch.delenv("PRSNET_API_KEY")
    monkeypatch.delenv("prsnet_max_face")
    assert settings.settings_of_environment(queue=3).port == 9123


def test_limits_of_the_first_version_of_cgroups_count(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name, path, content in (
        ("_CGROUP_QUOTA", "none", None), ("_CGROUP_MEMORY", "none", None), ("_V1_QUOTA", "quota", "200000"),
        ("_V1_PERIOD", "period", "100000"), ("_V1_MEMORY", "memory", str(1 << 30)),
    ):  # fmt: skip
        if content is not None:
            (tmp_path / path).write_text(content + "\n")
        monkeypatch.setattr(settings, name, tmp_path / path)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(4)))
    assert available_cores() == 2
    assert settings.memory_per_worker() == (1 << 30) * 3 // 4 // 2
    (tmp_path / "quota").write_text("-1\n")
    assert available_cores() == 4
