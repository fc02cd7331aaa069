"""Every error is a problem document with a stable type and the request's id."""

from typing import Any

import pytest

from app import problems
from model import errors

from .fakes import FakeDetector, Serving

pytestmark = pytest.mark.anyio


async def test_unknown_address(serving: Serving, detector: FakeDetector, assert_problem: Any) -> None:
    async with serving(detector) as (client, _):
        assert_problem(await client.get("/nowhere"), "not-found", 404)
        assert_problem(await client.get("/static/nowhere.js"), "not-found", 404)


async def test_wrong_method_names_the_right_one(serving: Serving, detector: FakeDetector, assert_problem: Any) -> None:
    async with serving(detector) as (client, _):
        response = await client.get("/detect")
        document = assert_problem(response, "method-not-allowed", 405)
        assert response.headers["allow"] == "POST"
        assert "POST" in document["detail"]


@pytest.mark.parametrize(
    ("query", "parameter"),
    [
        ("mode=quick", "mode"),
        ("max_error=0", "max_error"),
        ("max_error=-1", "max_error"),
        ("max_error=nan", "max_error"),
        ("max_error=inf", "max_error"),
        ("max_error=small", "max_error"),
        ("include=everything", "include.0"),
        ("mod=paper", "mod"),
    ],
)
async def test_bad_and_unknown_parameters(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any, query: str, parameter: str
) -> None:
    async with serving(detector) as (client, _):
        response = await client.post(f"/detect?{query}", files={"file": ("chair.obj", chair)})
        document = assert_problem(response, "invalid-parameter", 400)
        assert [item["parameter"] for item in document["errors"]] == [parameter]
        assert parameter in document["detail"]
        assert not detector.calls


@pytest.mark.parametrize(
    ("error", "slug", "status"),
    [
        (errors.UnsupportedFormatError, "unsupported-format", 415),
        (errors.UnreadableMeshError, "unreadable-mesh", 422),
        (errors.EmptyMeshError, "empty-mesh", 422),
        (errors.DegenerateMeshError, "degenerate-mesh", 422),
        (errors.MeshTooLargeError, "mesh-too-large", 413),
    ],
)
async def test_errors_of_the_model(
    serving: Serving,
    detector: FakeDetector,
    chair: bytes,
    assert_problem: Any,
    error: type[errors.MeshError],
    slug: str,
    status: int,
) -> None:
    detector.failure = error("What is wrong, and what to do.")
    async with serving(detector) as (client, _):
        response = await client.post("/detect", files={"file": ("chair.obj", chair)})
        assert assert_problem(response, slug, status)["detail"] == "What is wrong, and what to do."


def test_every_mesh_error_has_a_problem_of_its_own() -> None:
    kinds = errors.MeshError.__subclasses__()
    assert len({problems.for_mesh_error(kind("")).slug for kind in kinds}) == len(kinds)


async def test_a_defect_tells_the_id_and_nothing_else(
    serving: Serving,
    detector: FakeDetector,
    chair: bytes,
    assert_problem: Any,
    caplog: pytest.LogCaptureFixture,
) -> None:
    detector.failure = RuntimeError("secret path /srv/x")
    async with serving(detector) as (client, _):
        response = await client.post("/detect", files={"file": ("chair.obj", chair)})
        document = assert_problem(response, "internal-error", 500)
        assert "secret" not in response.text
        assert document["request_id"] in caplog.text  # so that the traceback can be found
        assert "secret path" in caplog.text
        detector.tell(failure=None)
        assert (await client.post("/detect", files={"file": ("chair.obj", chair)})).status_code == 200


@pytest.mark.parametrize("bad", ["", "a b", "x" * 129, "a\tb", "<script>", "naïve"])
async def test_request_id_is_kept_if_sane(serving: Serving, detector: FakeDetector, bad: str) -> None:
    async with serving(detector) as (client, _):
        kept = await client.get("/health", headers={"X-Request-ID": "job-17.a:b_c"})
        assert kept.headers["x-request-id"] == "job-17.a:b_c"
        replaced = await client.get("/health", headers={"X-Request-ID": bad.encode()})
        assert replaced.headers["x-request-id"] not in ("", bad)
        assert replaced.headers["x-request-id"].isalnum()
