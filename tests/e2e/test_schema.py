"""Requests that schemathesis makes up from the OpenAPI document: no 5xx, and every error is a problem document."""

import json
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings

from .server import ROOT, Server

DOCUMENT = json.loads((Path(ROOT) / "docs" / "openapi.json").read_text())
CHECKS = [schemathesis.checks.response_schema_conformance, schemathesis.checks.status_code_conformance]
OPERATIONS = [(method, path) for path, operations in DOCUMENT["paths"].items() for method in operations]


@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_no_request_made_from_the_schema_meets_a_defect(server: Server, method: str, path: str) -> None:
    operation = schemathesis.openapi.from_dict(DOCUMENT)[path][method.upper()]

    @given(case=operation.as_strategy())
    @settings(
        max_examples=25 if path == "/detect" else 5,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    def check(case: Any) -> None:
        response = case.call(base_url=server.url)
        assert response.status_code < 500, response.text
        if response.status_code >= 400:
            assert "application/problem+json" in response.headers["content-type"]
            document = response.json()
            assert document["status"] == response.status_code
            assert document["type"].startswith("/problems/")
        case.validate_response(response, checks=CHECKS)

    check()
