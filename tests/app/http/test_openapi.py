"""The OpenAPI document: kept in the repository, complete, its examples valid; docs without internet."""

import re
from pathlib import Path
from typing import Any

import pytest

from app import problems, schemas
from app.http.main import create_app
from app.http.openapi import dump
from app.settings import Settings
from tests.app.fakes import FakeDetector, Serving

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return create_app(Settings()).openapi()


def test_copy_in_the_repository_is_current() -> None:
    assert (ROOT / "docs" / "openapi.json").read_text() == dump(create_app(Settings())), (
        "renew it with: python docs/make_openapi.py"
    )


def test_every_error_is_a_problem_with_an_example_that_obeys_the_schema(document: dict[str, Any]) -> None:
    seen: set[str] = set()
    for operations in document["paths"].values():
        for operation in operations.values():
            for status, answer in operation["responses"].items():
                if status.startswith(("2", "3")):
                    continue
                assert list(answer["content"]) == ["application/problem+json"]
                content = answer["content"]["application/problem+json"]
                assert content["schema"] == {"$ref": "#/components/schemas/Problem"}
                for slug, example in content["examples"].items():
                    problem = schemas.Problem.model_validate(example["value"])
                    assert (problem.type, str(problem.status)) == (f"/problems/{slug}", status)
                    seen.add(slug)
    catalogue = {value.slug for value in vars(problems).values() if isinstance(value, problems.ProblemType)}
    assert seen == catalogue - {"not-found", "method-not-allowed"}  # those two belong to no operation


def test_detect_documents_request_and_answer(document: dict[str, Any]) -> None:
    operation = document["paths"]["/detect"]["post"]
    assert set(operation["responses"]) == {
        "200",
        "304",
        "400",
        "401",
        "406",
        "408",
        "413",
        "415",
        "422",
        "500",
        "503",
        "504",
    }
    names = {parameter["name"] for parameter in operation["parameters"]}
    assert names == {"mode", "max_error", "level", "tolerance", "include", "format", "If-None-Match"}
    assert "content" not in operation["responses"]["304"]
    assert operation["requestBody"]["content"]["multipart/form-data"]["schema"]["required"] == ["file"]
    content = operation["responses"]["200"]["content"]["application/json"]
    assert content["schema"] == {"$ref": "#/components/schemas/DetectResponse"}
    schemas.DetectResponse.model_validate(content["example"])
    assert "curl -F file=@" in operation["x-codeSamples"][0]["source"]


def test_every_reference_resolves(document: dict[str, Any]) -> None:
    for name in re.findall(r"'#/components/schemas/(\w+)'", str(document)):
        assert name in document["components"]["schemas"]


@pytest.mark.anyio
async def test_docs_need_nothing_from_elsewhere(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector) as (client, _):
        page = await client.get("/docs")
        assert page.headers["content-type"].startswith("text/html")
        assert page.headers["content-security-policy"].startswith("default-src 'self'")
        assert "//" not in page.text
        assert "<script>" not in page.text
        linked = re.findall(r'(?:href|src)="([^"]+)"', page.text)
        assert len(linked) == 4
        for url in linked:
            assert (await client.get(f"/{url}")).status_code == 200
        script = (await client.get("/static/docs.js")).text
        assert "validatorUrl: null" in script
        assert '"openapi.json"' in script
        assert (await client.get("/openapi.json")).json()["openapi"].startswith("3.")
        assert (await client.get("/redoc")).status_code == 404
