"""``prsnet`` as a process: many files over several cores, with a running service, and what its exit codes tell."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

from .server import ROOT, Server


def prsnet(*arguments: str | Path) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-W", "error", "-m", "app", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240, check=False)


def folder(data: Path, tmp_path: Path) -> Path:
    """Three meshes, one of them deeper, a broken one and a file that is no mesh."""
    meshes = tmp_path / "meshes"
    (meshes / "deeper").mkdir(parents=True)
    for name in ("chair.obj", "deeper/vase.ply", "plant.off"):
        shutil.copy(data / Path(name).name, meshes / name)
    (meshes / "broken.stl").write_bytes(b"solid nothing")
    (meshes / "README.md").write_text("no mesh")
    return meshes


def test_a_folder_over_several_processes(data: Path, tmp_path: Path) -> None:
    meshes = folder(data, tmp_path)
    result = prsnet("detect", meshes, "--jsonl", "--glb", "-o", tmp_path / "out", "--jobs", "2")
    assert result.returncode == 1, result.stderr
    answers = [json.loads(line) for line in result.stdout.splitlines()]
    assert [(answer["mesh"]["filename"], answer["point_group"]) for answer in answers] == [
        (str(meshes / "chair.obj"), "Cs"), (str(meshes / "deeper/vase.ply"), "C8v"), (str(meshes / "plant.off"), "C1")
    ]  # fmt: skip
    assert result.stderr.splitlines()[0] == "1 of 4 failed:"
    assert result.stderr.splitlines()[1].startswith(f"{meshes / 'broken.stl'}: ")
    assert len(result.stderr.splitlines()) == 2
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert written == ["chair-symmetries.glb", "plant-symmetries.glb", "vase-symmetries.glb"]


def test_a_service_gives_the_same_answers(server: Server, data: Path, tmp_path: Path) -> None:
    meshes = folder(data, tmp_path)
    remote = prsnet("detect", meshes, "--csv", "--url", server.url, "-j", "2")
    local = prsnet("detect", meshes, "--csv", "-j", "1")
    assert (remote.returncode, remote.stdout, remote.stderr) == (local.returncode, local.stdout, local.stderr)
    assert remote.stdout.count("vase.ply") == 9
    completed = prsnet("complete", meshes / "chair.obj", "-o", tmp_path / "c.stl", "--url", server.url)
    assert completed.returncode == 0
    assert "0 added (0.0 % of the surface)" in completed.stdout
    assert (tmp_path / "c.stl").stat().st_size == 84 + 50 * 260


def test_half_and_aligned_copy_are_the_same_from_a_service(server: Server, data: Path, tmp_path: Path) -> None:
    low, high = server.detect("chair.obj", (data / "chair.obj").read_bytes()).json()["mesh"]["bounds"]
    given = ["--normal", "1,0,0", f"--offset={-0.7 * low[0] - 0.3 * high[0]}"]
    about = ["--axis", "0,1,0", "--point", "0.1,0,0.2", "--order", "3", "--start", "1,0,0.3", "--open"]
    for command, more in (
        ("halve", ["--other"]), ("halve", [*given, "--capped", "--fem"]), ("sector", [*about, "--fem"]), ("align", [])
    ):  # fmt: skip
        here, there = tmp_path / "here.ply", tmp_path / "there.ply"
        local = prsnet(command, data / "chair.obj", "-o", here, "--overwrite", *more)
        remote = prsnet(command, data / "chair.obj", "-o", there, "--overwrite", "--url", server.url, *more)
        assert (local.returncode, remote.returncode) == (0, 0), remote.stderr
        assert local.stdout.replace("here.ply", "there.ply") == remote.stdout
        assert here.read_bytes() == there.read_bytes()
    moved = server.detect("there.ply", there.read_bytes()).json()
    assert (moved["planes"][0]["normal"], moved["planes"][0]["offset"]) == ([1.0, 0.0, 0.0], 0.0)


def test_a_taken_port_is_told(server: Server) -> None:
    port = server.url.rpartition(":")[2]
    second = prsnet("serve", "--port", port)
    assert second.returncode == 1
    assert f"port {port} of 127.0.0.1 is in use: choose another one with --port" in second.stderr


def test_exit_codes(data: Path, tmp_path: Path) -> None:
    nobody = prsnet("detect", data / "chair.obj", "--url", "http://127.0.0.1:9")
    assert (nobody.returncode, nobody.stdout) == (4, "")
    assert "No answer" in nobody.stderr
    nothing = prsnet("detect", tmp_path / "*.obj")
    assert nothing.returncode == 3
    assert nothing.stderr == f"{tmp_path}/*.obj: No file has such a name.\n"
    assert prsnet("complete", data / "plant.off", "-o", tmp_path / "x.ply").returncode == 1
    help_text = prsnet("detect", "--help")
    assert help_text.returncode == 0
    assert "Exit codes: 0 all went well" in " ".join(help_text.stdout.split())
    assert "--install-completion" in prsnet("--help").stdout
