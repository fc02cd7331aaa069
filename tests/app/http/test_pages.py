"""The pages for people: policies, caching, links; the viewer's build as it is shipped."""

import html
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from setuptools import find_namespace_packages

from model.formats import FORMATS
from tests.app.fakes import FakeDetector, Serving

pytestmark = pytest.mark.anyio
ROOT = Path(__file__).parents[3]
BUILT = ROOT / "app" / "static" / "viewer"


async def test_the_viewer_needs_nothing_from_elsewhere(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector) as (client, _):
        page = await client.get("/")
        policy = dict(part.split(" ", 1) for part in page.headers["content-security-policy"].split("; "))
        assert policy["default-src"] == "'none'"
        assert policy["script-src"] == policy["style-src"] == policy["worker-src"] == policy["connect-src"] == "'self'"
        assert "unsafe" not in str(policy)
        assert "<script>" not in page.text
        linked = re.findall(r'(?:href|src)="([^"#]+)"', page.text)
        assert len(linked) >= 5
        for url in linked:
            assert not url.startswith("/")  # relative: there may be a path prefix
            assert "//" not in url
            assert (await client.get(f"/{url}")).status_code == 200


async def test_the_viewer_is_told_the_formats(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector) as (client, _):
        page = await client.get("/")
        stated = re.search(r'<meta name="formats" content="([^"]*)"', page.text)
        assert stated
        formats = json.loads(html.unescape(stated[1]))
        limits = (await client.get("/model")).json()["limits"]
        assert [format["extension"] for format in formats["read"]] == limits["formats"] == list(FORMATS)
        document = (await client.get("/openapi.json")).json()
        (query,) = (item for item in document["paths"]["/complete"]["post"]["parameters"] if item["name"] == "format")
        assert formats["written"] == query["schema"]["enum"]


async def test_caches_keep_what_never_changes_and_ask_for_the_rest(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector) as (client, _):
        page = await client.get("/")
        assert page.headers["cache-control"] == "no-cache"
        script = re.search(r'src="(static/viewer/viewer-[A-Z0-9]{8}\.js)"', page.text)
        assert script
        kept = await client.get(f"/{script[1]}")
        assert "immutable" in kept.headers["cache-control"]
        icon = await client.get("/static/viewer/icon.svg")
        assert icon.headers["cache-control"] == "no-cache"
        again = await client.get("/static/viewer/icon.svg", headers={"If-None-Match": icon.headers["etag"]})
        assert again.status_code == 304


async def test_each_page_can_be_had_alone(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector, docs=False) as (client, _):
        page = await client.get("/")
        assert 'href="docs"' not in page.text
        assert (await client.get("/docs")).status_code == 404
    async with serving(detector, viewer=False) as (client, _):
        assert (await client.get("/")).status_code == 404
        assert (await client.get("/docs")).status_code == 200


async def test_pages_need_no_key(serving: Serving, detector: FakeDetector) -> None:
    async with serving(detector, api_keys="secret") as (client, _):
        assert (await client.get("/")).status_code == 200  # it asks for the key itself


def test_every_problem_has_words_in_the_viewer() -> None:
    from app import problems

    source = (ROOT / "app" / "viewer" / "src" / "problems.ts").read_text(encoding="utf-8")
    known = set(re.findall(r'^  "?([a-z-]+)"?: words\(', source, re.MULTILINE))
    slugs = {value.slug for value in vars(problems).values() if isinstance(value, problems.ProblemType)}
    assert len(slugs) > 15
    assert slugs <= known


def test_the_wheel_has_the_built_viewer_and_not_its_sources() -> None:
    tool: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    packages = find_namespace_packages(str(ROOT), **tool["packages"]["find"])
    assert "app" in packages
    assert [name for name in packages if name.startswith("app.viewer")] == []
    assert tool["package-data"]["app"] == ["py.typed", "static/**"]
    assert len(list((BUILT / "examples").iterdir())) >= 16
    assert "MIT" in (BUILT / "three-LICENSE.txt").read_text(encoding="utf-8")


def test_locked_packages_are_exact_and_name_no_address() -> None:
    lock = (ROOT / "app" / "viewer" / "package-lock.json").read_text(encoding="utf-8")
    assert "resolved" not in lock
    manifest = (ROOT / "app" / "viewer" / "package.json").read_text(encoding="utf-8")
    versions = re.findall(r'"[@a-z/-]+": "([^"]*\d[^"]*)"', manifest)
    assert len(versions) >= 5
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in versions)
