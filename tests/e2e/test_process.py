"""The server as a process: start-up, health under load, shutdown; and the command line beside it."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import pytest
import trimesh

from tests import load

from .geometry import as_file
from .server import ROOT, Server, launched, running


@pytest.fixture(scope="module")
def big_mesh() -> bytes:
    """A sphere of 81,920 faces: every axis survives the sweep, so a request can be watched while it runs."""
    return as_file(trimesh.creation.icosphere(subdivisions=6), "stl")


def test_health_answers_while_a_detection_runs(server: Server, big_mesh: bytes) -> None:
    answers: list[httpx.Response] = []
    worker = threading.Thread(target=lambda: answers.append(server.detect("big.stl", big_mesh)))
    worker.start()
    seen: list[int] = []
    with httpx.Client(base_url=server.url, timeout=60) as client:
        while worker.is_alive():
            seen.append(client.get("/health").status_code)
    worker.join()
    assert answers[0].status_code == 200
    assert set(seen) == {200}
    assert len(seen) > 5  # a blocked event loop would have answered once or twice


def test_sigterm_finishes_what_runs_and_turns_traffic_away(tmp_path: Path, big_mesh: bytes) -> None:
    with running(tmp_path / "log", DRAIN_S="1") as server:
        answers: list[httpx.Response] = []
        worker = threading.Thread(target=lambda: answers.append(server.detect("big.stl", big_mesh)))
        worker.start()
        with httpx.Client(base_url=server.url, timeout=60) as client:
            assert client.get("/health").status_code == 200
            server.process.send_signal(signal.SIGTERM)
            statuses: list[int] = []
            try:
                while True:
                    statuses.append(client.get("/health").status_code)
            except httpx.TransportError:
                pass  # the port is closed
        worker.join()
        assert statuses[-1] == 503
        assert answers[0].status_code == 200
        assert answers[0].json()["mesh"]["faces"] == 81_920
        assert server.process.wait(60) == 0, server.log.read_text()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_worker_has_nothing_open_but_the_way_to_the_server(server: Server) -> None:
    workers = load.workers_of(server.process.pid)
    assert workers
    for worker in workers:
        folder = Path(f"/proc/{worker}/fd")
        opened = sorted(str((folder / name).readlink()).split(":")[0] for name in os.listdir(folder))
        assert opened == ["/dev/null"] * 3 + ["socket"]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_no_key_is_in_the_memory_of_the_processes_that_parse(tmp_path: Path, data: Path) -> None:
    key = "k7Qz-no-worker-may-know"
    with running(tmp_path / "log", API_KEYS=key, WORKERS="1") as server:
        files = {"file": ("chair.obj", (data / "chair.obj").read_bytes())}
        answer = httpx.post(f"{server.url}/detect", files=files, headers={"X-API-Key": key}, timeout=60)
        assert answer.status_code == 200
        parsing = list(load.processes(server.process.pid))
        assert len(parsing) == 3  # what forks, the worker, and the spare one
        assert holds(server.process.pid, key.encode())
        assert not any(holds(pid, key.encode()) for pid in parsing)


def holds(pid: int, text: bytes) -> bool:
    """Whether what a process may write to has these bytes anywhere, as its parent may see."""
    with open(f"/proc/{pid}/maps") as maps, open(f"/proc/{pid}/mem", "rb", buffering=0) as memory:
        for line in maps:
            span, permissions = line.split()[:2]
            first, end = (int(part, 16) for part in span.split("-"))
            if permissions.startswith("rw"):
                memory.seek(first)
                if text in memory.read(end - first):
                    return True
    return False


@pytest.mark.skipif(sys.platform != "linux", reason="stops a process by signal")
def test_a_process_that_forks_and_hangs_is_replaced_when_a_worker_is_needed(tmp_path: Path) -> None:
    with running(tmp_path / "log", WORKERS="1") as server:
        hanging = load.zygote_of(server.process.pid)
        workers = load.workers_of(server.process.pid)
        os.kill(hanging, signal.SIGSTOP)
        for worker in workers:
            os.kill(worker, signal.SIGKILL)
        end = time.monotonic() + 60
        while server.health() != 200 or load.zygote_of(server.process.pid) == hanging:
            assert time.monotonic() < end, server.log.read_text()
            time.sleep(0.2)
        assert server.detect("chair.obj", (ROOT / "tests/data/chair.obj").read_bytes()).status_code == 200
        assert server.process.poll() is None


def test_starting_server_is_alive_but_not_ready(tmp_path: Path) -> None:
    with launched(tmp_path / "log") as server:
        states: list[tuple[int, int]] = []
        while not states or states[-1] != (200, 200):
            assert server.process.poll() is None, server.log.read_text()
            try:
                health = server.health()
                states.append((httpx.get(f"{server.url}/health/live").status_code, health))
            except httpx.TransportError:
                continue
        assert states[0] == (200, 503)
        assert set(states) == {(200, 503), (200, 200)}
    log = server.log.read_text()
    assert log.count("settings: ") == 1
    assert f"port={server.port}" in log


def test_deadline_is_kept_and_ends_the_work(tmp_path: Path, big_mesh: bytes) -> None:
    with running(tmp_path / "log", DEADLINE_S="0.05", WORKERS="1", QUEUE="0") as server:
        response = server.detect("big.stl", big_mesh)
        assert response.status_code == 504
        assert response.json()["type"] == "/problems/deadline-passed"
        assert server.health() == 200
        server.process.send_signal(signal.SIGINT)
        assert server.process.wait(30) == 0


def test_weights_that_do_not_load_end_the_process_with_an_error(tmp_path: Path) -> None:
    (tmp_path / "bad.safetensors").write_bytes(b"not weights")
    with launched(tmp_path / "log", WEIGHTS=str(tmp_path / "bad.safetensors")) as server:
        assert server.process.wait(60) == 1
    assert "start-up failed" in server.log.read_text()


def test_docs_and_everything_they_load_come_from_the_server(server: Server) -> None:
    page = httpx.get(f"{server.url}/docs").text
    links = re.findall(r'(?:href|src)="([^"]+)"', page)
    assert len(links) >= 3
    for link in links:
        assert "//" not in link
        assert httpx.get(f"{server.url}/{link}").status_code == 200
    stylesheet = httpx.get(f"{server.url}/static/swagger/swagger-ui.css").text
    assert all(url.startswith(("data:", '"data:')) for url in re.findall(r"url\(([^)]*)", stylesheet))
    assert "@import" not in stylesheet
    assert "/detect" in httpx.get(f"{server.url}/openapi.json").json()["paths"]


def test_model_card_names_the_served_weights(server: Server, data: Path) -> None:
    card = httpx.get(f"{server.url}/model").json()
    assert re.fullmatch(r"[0-9a-f]{64}", card["sha256"])
    assert card["metadata"]
    answer = server.detect("chair.obj", (data / "chair.obj").read_bytes()).json()
    assert answer["model"] == {name: card[name] for name in ("name", "version", "sha256")}


def prsnet(*arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-W", "error", "-m", "app", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=180, check=False)


def test_command_line_answers_as_the_server_does(server: Server, data: Path) -> None:
    result = prsnet("detect", "--json", str(data / "chair.obj"), str(data / "README.md"))
    assert result.returncode == 1
    assert "README.md: " in result.stderr
    [printed] = json.loads(result.stdout)  # a list, as several files were given
    served = server.detect("chair.obj", (data / "chair.obj").read_bytes()).json()
    for answer in (printed, served):
        del answer["timings_ms"]
    assert printed["mesh"].pop("filename") == str(data / "chair.obj")  # files of many folders are told apart by it
    assert served["mesh"].pop("filename") == "chair.obj"
    assert printed == served


def test_command_line_for_people(data: Path) -> None:
    result = prsnet("detect", str(data / "chair.obj"))
    assert result.returncode == 0, result.stderr
    assert "chair.obj" in result.stdout
    assert "normal" in result.stdout


def test_warmup_reports_a_detection() -> None:
    result = prsnet("warmup")
    assert result.returncode == 0, result.stderr
    assert re.search(r"loaded and warmed up in [\d.]+ s; a box has \d+ planes", result.stdout)
