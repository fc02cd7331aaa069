"""Answers are kept for files that are sent again: told by headers, bounded, never mixed up, and off by a setting."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from .server import ROOT, Server, running

DATA = ROOT / "tests" / "data"
CHAIR = (DATA / "chair.obj").read_bytes()
LIMIT = 100_000


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    log = tmp_path_factory.mktemp("cache") / "log"
    with running(log, WORKERS="1", CACHE_BYTES=str(LIMIT), API_KEYS="one,two") as started:
        yield started


def ask(
    server: Server, content: bytes = CHAIR, name: str = "chair.obj", key: str = "one", **query: Any
) -> httpx.Response:
    headers = {"X-API-Key": key, **query.pop("headers", {})}
    task = query.pop("task", "detect")
    url = f"{server.url}/{task}"
    return httpx.post(url, files={"file": (name, content)}, params=query, headers=headers, timeout=60)


def metric(server: Server, name: str) -> float:
    text = httpx.get(f"{server.url}/metrics", headers={"X-API-Key": "one"}).text
    return next(float(line.split()[1]) for line in text.splitlines() if line.startswith(f"prsnet_{name} "))


def test_a_file_that_comes_again_gets_the_same_answer_without_a_worker(server: Server) -> None:
    content = CHAIR + b"# again\n"
    first, again = ask(server, content), ask(server, content)
    assert (first.status_code, again.status_code) == (200, 200)
    assert (first.headers["prsnet-cache"], again.headers["prsnet-cache"]) == ("miss", "hit")
    assert again.content == first.content
    assert again.headers["etag"] == first.headers["etag"]
    assert "worker;dur" in first.headers["server-timing"]
    assert "worker;dur" not in again.headers["server-timing"]


@pytest.mark.parametrize(
    "other",
    [
        {"name": "table.obj"}, {"content": CHAIR + b"#"}, {"mode": "paper"}, {"max_error": 1e-3}, {"level": "exact"},
        {"tolerance": 0.1}, {"include": "rejected"}, {"format": "csv"}, {"format": "glb"}, {"task": "complete"},
    ],
)  # fmt: skip
def test_what_differs_in_anything_is_another_question(server: Server, other: dict[str, Any]) -> None:
    plain, changed = ask(server), ask(server, **other)
    assert changed.status_code == 200
    assert changed.headers["etag"] != plain.headers["etag"]
    assert changed.content != plain.content
    assert ask(server, **other).content == changed.content


def test_formats_of_one_answer_share_what_was_computed(server: Server) -> None:
    content = CHAIR + b"# formats\n"
    assert ask(server, content).headers["prsnet-cache"] == "miss"
    rows = ask(server, content, format="csv")
    assert rows.headers["prsnet-cache"] == "hit"
    assert rows.headers["content-type"].startswith("text/csv")


@pytest.mark.parametrize("query", [{}, {"format": "glb"}, {"task": "complete"}])
def test_who_has_the_answer_already_is_told_so(server: Server, query: dict[str, Any]) -> None:
    tag = ask(server, **query).headers["etag"]
    assert tag.startswith('W/"')
    for condition in (tag, tag.removeprefix("W/"), f'"other", {tag}'):
        answer = ask(server, headers={"If-None-Match": condition}, **query)
        assert (answer.status_code, answer.content) == (304, b"")
        assert answer.headers["etag"] == tag
        assert "x-request-id" in answer.headers
    for condition in ('W/"other"', "*", ""):
        assert ask(server, headers={"If-None-Match": condition}, **query).status_code == 200
    assert ask(server, CHAIR + b"# new", headers={"If-None-Match": tag}, **query).status_code == 200


def test_keys_do_not_see_each_others_files(server: Server) -> None:
    content = CHAIR + b"# secret\n"
    assert ask(server, content, key="one").headers["prsnet-cache"] == "miss"
    assert ask(server, content, key="two").headers["prsnet-cache"] == "miss"
    assert ask(server, content, key="two").headers["prsnet-cache"] == "hit"


def test_errors_are_not_kept(server: Server) -> None:
    for _ in range(2):
        answer = ask(server, b"v 0 0 0\n")
        assert answer.status_code == 422
        assert "etag" not in answer.headers
        assert "prsnet-cache" not in answer.headers


def test_what_is_kept_is_bounded_and_the_oldest_makes_room(server: Server) -> None:
    ask(server, CHAIR + b"# 0\n")
    size = len(ask(server, CHAIR + b"# 0\n").content)
    count = LIMIT // size + 2
    for number in range(1, count):
        ask(server, CHAIR + b"# %d\n" % number)
    assert 0 < metric(server, "cache_bytes") <= LIMIT
    assert ask(server, CHAIR + b"# %d\n" % (count - 1)).headers["prsnet-cache"] == "hit"
    assert ask(server, CHAIR + b"# 0\n").headers["prsnet-cache"] == "miss"
    assert metric(server, "cache_hits") > 0 < metric(server, "cache_misses")


def test_files_on_disk_and_in_several_parts_are_told_apart(server: Server) -> None:
    large = CHAIR + b"#" * (2 << 20)
    assert [ask(server, large).headers["prsnet-cache"] for _ in range(2)] == ["miss", "hit"]
    assert ask(server, large[:-1] + b"!").headers["prsnet-cache"] == "miss"
    headers = {"X-API-Key": "one"}
    found = []
    for parts in ((b"ab", b"c"), (b"a", b"bc"), (b"ab", b"c")):
        files = [("file", ("chair.obj", CHAIR)), *(("file", (f"{n}.bin", part)) for n, part in enumerate(parts))]
        answer = httpx.post(f"{server.url}/detect", files=files, headers=headers, timeout=60)
        found.append(answer.headers["prsnet-cache"])
    assert found == ["miss", "miss", "hit"]


def test_off_by_a_setting(tmp_path: Path) -> None:
    with running(tmp_path / "log", WORKERS="1", CACHE_BYTES="0") as server:
        first = ask(server)
        for answer in (first, ask(server), ask(server, headers={"If-None-Match": "*"})):
            assert answer.status_code == 200
            assert "etag" not in answer.headers
            assert "prsnet-cache" not in answer.headers
            assert "worker;dur" in answer.headers["server-timing"]
