"""What an operator and a browser see: metrics, logs, Server-Timing, security headers, keys, switches."""

import json
import logging
import re
from typing import Any

import pytest

from app.http import tracing
from app.logs import JsonFormatter
from app.settings import Settings
from tests.app.fakes import FakeDetector, Serving

pytestmark = pytest.mark.anyio


def values(text: str) -> dict[str, float]:
    """Prometheus' text as sample -> value."""
    lines = [line.rsplit(" ", 1) for line in text.splitlines() if line and not line.startswith("#")]
    return {name: float(value) for name, value in lines}


async def test_metrics_count_what_happened(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector) as (client, _):
        for name in ("chair.obj", "chair.obj", "chair.step"):
            await client.post("/detect", files={"file": (name, chair)})
        await client.get("/nowhere/at/all")
        answer = await client.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    seen = values(answer.text)
    assert seen['prsnet_requests_total{method="POST",route="/detect",status="200"}'] == 2
    assert seen['prsnet_requests_total{method="POST",route="/detect",status="415"}'] == 1
    assert seen['prsnet_requests_total{method="GET",route="other",status="404"}'] == 1
    assert seen['prsnet_rejections_total{reason="unsupported-format"}'] == 1
    assert seen['prsnet_request_seconds_count{route="/detect"}'] == 3
    for stage in ("parse", "infer", "validate", "worker"):
        assert seen[f'prsnet_stage_seconds_count{{stage="{stage}"}}'] == 2
    assert seen['prsnet_stage_seconds_count{stage="upload"}'] == 3
    assert seen["prsnet_queue_depth"] == seen["prsnet_jobs_running"] == seen["prsnet_uploading"] == 0
    assert seen["prsnet_workers_live"] == 2
    assert seen["prsnet_ready"] == 1
    assert seen[f'prsnet_model_info{{name="fake",sha256="{"f" * 64}",version="0"}}'] == 1
    assert "nowhere" not in answer.text  # a client chooses no label


async def test_one_line_a_request_without_its_content(
    serving: Serving, detector: FakeDetector, chair: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    async with serving(detector) as (client, _):
        for name in ("s3cr3t.obj", "s3cr3t.step"):
            headers = {"X-Request-ID": f"job-{name[-4:]}"}
            await client.post("/detect?mode=paper", files={"file": (name, chair + b"# s3cr3t\n")}, headers=headers)
    records = [record for record in caplog.records if record.name == "prsnet.access"]
    lines = [json.loads(JsonFormatter().format(record)) for record in records]
    assert [(line["request_id"], line["status"], line["path"]) for line in lines] == [
        ("job-.obj", 200, "/detect"),
        ("job-step", 415, "/detect"),
    ]
    assert lines[0]["stages_ms"]["parse"] > 0
    assert lines[1]["problem"] == "unsupported-format"
    assert "s3cr3t" not in caplog.text


def test_a_json_log_line_is_one_line_and_keeps_the_exception() -> None:
    try:
        raise ValueError("two\nlines")
    except ValueError as error:
        record = logging.LogRecord("x", logging.ERROR, "", 0, 'odd "%s"\n', ("ü",), (ValueError, error, None))
    line = JsonFormatter().format(record)
    assert "\n" not in line
    entry = json.loads(line)
    assert entry["message"] == 'odd "ü"\n'
    assert "ValueError: two\nlines" in entry["exception"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", entry["time"])


async def test_server_timing_tells_the_stages(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector) as (client, _):
        answer = await client.post("/detect", files={"file": ("chair.obj", chair)})
    entries = dict(entry.split(";dur=") for entry in answer.headers["server-timing"].split(", "))
    assert list(entries) == ["upload", "queue", "parse", "voxelize", "infer", "refine", "validate", "worker"]
    assert float(entries["infer"]) == 0.2
    assert float(entries["worker"]) == pytest.approx(answer.json()["timings_ms"]["total"], abs=0.01)


async def test_every_answer_has_security_headers(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector) as (client, _):
        for path in ("/health", "/nowhere", "/docs", "/metrics", "/static/docs.js"):
            headers = (await client.get(path, headers={"Origin": "https://other.example"})).headers
            assert headers["x-content-type-options"] == "nosniff"
            assert headers["x-frame-options"] == "DENY"
            assert headers["referrer-policy"] == "no-referrer"
            assert ("default-src 'none'" in headers["content-security-policy"]) == (path != "/docs")
            assert "access-control-allow-origin" not in headers


async def test_origins_that_are_allowed_are_told_so(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector, cors_origins="https://a.example, https://b.example") as (client, _):
        for origin, allowed in (("https://a.example", True), ("https://c.example", False)):
            headers = (await client.get("/health", headers={"Origin": origin})).headers
            assert (headers.get("access-control-allow-origin") == origin) == allowed


async def test_pages_and_metrics_can_be_switched_off(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector, viewer=False, docs=False, metrics=False) as (client, _):
        for path in ("/", "/docs", "/openapi.json", "/static/docs.js", "/metrics"):
            assert (await client.get(path)).status_code == 404
        assert (await client.get("/health")).status_code == 200


async def test_keys(serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any) -> None:
    files = {"file": ("chair.obj", chair)}
    async with serving(detector, api_keys="first-key, sécond") as (client, runtime):
        for headers in ({}, {"X-API-Key": "first"}, {"X-API-Key": ""}, {"Authorization": "Basic first-key"}):
            refused = await client.post("/detect?mode=nonsense", files=files, headers=headers)
            assert_problem(refused, "unauthorized", 401)
            assert refused.headers["www-authenticate"] == "Bearer"
        assert (await client.get("/model")).status_code == 401
        assert (await client.get("/metrics")).status_code == 401
        assert (await client.get("/health")).status_code == 200  # a load balancer has no key
        for headers in ({"X-API-Key": "first-key"}, {"Authorization": "Bearer first-key"}):
            assert (await client.post("/detect", files=files, headers=headers)).status_code == 200
        assert "first-key" not in runtime.settings.summary() + repr(runtime.settings)
        assert len(detector.calls) == 2


async def test_traces(serving: Serving, detector: FakeDetector, chair: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    memory = pytest.importorskip("opentelemetry.sdk.trace.export.in_memory_span_exporter").InMemorySpanExporter()
    original = tracing.tracer
    monkeypatch.setattr(tracing, "tracer", lambda: original(memory))
    parent = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"
    async with serving(detector, otel=True) as (client, _):
        await client.post("/detect", files={"file": ("chair.obj", chair)}, headers={"traceparent": parent})
    (span,) = memory.get_finished_spans()
    assert span.name == "POST /detect"
    assert f"{span.context.trace_id:032x}" == parent.split("-")[1]
    assert span.attributes["http.response.status_code"] == 200
    assert span.attributes["prsnet.infer_ms"] == 0.2


def test_keys_come_from_the_environment_and_stay_out_of_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRSNET_API_KEYS", "abc,def")
    settings = Settings()
    assert settings.api_keys.get_secret_value() == "abc,def"
    assert "abc" not in settings.summary()
