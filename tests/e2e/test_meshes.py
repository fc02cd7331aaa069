"""Real meshes through a real server: what comes back must be true of the mesh that went in."""

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from .geometry import angle_degrees, as_file, embedded_gltf, symmetry_error
from .server import Server

MAX_ERROR = 4e-4
MESHES = ["chair.obj", "table.glb", "stool.3mf", "vase.ply", "barrel.stl", "donut.gltf", "plant.off"]


def load(path: Path) -> trimesh.Trimesh:
    return trimesh.load(path, process=False, force="mesh")


def tilt() -> Any:
    """A rotation about a skew axis, then a translation."""
    matrix = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])
    matrix[:3, 3] = [10, -20, 30]
    return matrix


def check_answer(mesh: trimesh.Trimesh, answer: dict[str, Any], max_error: float) -> None:
    """Every claim of an answer that can be verified on the mesh alone."""
    scale, center = answer["frame"]["scale"], np.array(answer["frame"]["center"])
    low, high = np.array(answer["mesh"]["bounds"])
    extent = np.linalg.norm(high - low)
    assert np.allclose([low, high], mesh.bounds, atol=1e-6 * extent)
    weights = mesh.area_faces / mesh.area
    assert np.allclose(center, weights @ mesh.triangles_center, atol=1e-6 * extent)
    farthest = np.linalg.norm(mesh.vertices[np.unique(mesh.faces)] - center, axis=1).max()
    assert scale == pytest.approx(2 * farthest)

    # Planes: exact ones first, then the surest, then by error. Axes: continuous ones and higher orders before that.
    def place(item: dict[str, Any]) -> tuple[bool, float, float]:
        return not item["exact"], -(item["confidence"] or 0.0), item["symmetry_error"]

    planes = [place(plane) for plane in answer["planes"]]
    axes = [(-(axis["order"] or np.inf), *place(axis)) for axis in answer["axes"]]
    assert planes == sorted(planes)
    assert axes == sorted(axes)
    assert all(item["symmetry_error"] <= max_error for item in (*answer["planes"], *answer["axes"]))
    for plane in answer["planes"]:
        normal, matrix = np.array(plane["normal"]), np.array(plane["matrix"])
        assert np.linalg.norm(normal) == pytest.approx(1)
        assert normal[np.flatnonzero(normal)[0]] > 0
        assert abs(normal @ plane["point"] + plane["offset"]) < 1e-9 * extent
        assert np.allclose(np.cross(np.array(plane["point"]) - center, normal), 0, atol=1e-9 * extent)
        assert np.allclose(matrix[:3, :3], np.eye(3) - 2 * np.outer(normal, normal))
        assert np.allclose(matrix @ matrix, np.eye(4), atol=1e-9 * extent)
        assert plane["rms_distance"] == pytest.approx(np.sqrt(plane["symmetry_error"]) * scale)
        measured = symmetry_error(mesh, matrix, scale)
        assert measured <= 1.5 * max_error
        assert measured == pytest.approx(plane["symmetry_error"], rel=0.5, abs=1e-6)
    for axis in answer["axes"]:
        assert np.linalg.norm(axis["direction"]) == pytest.approx(1)
        if axis["continuous"]:
            assert axis["order"] is None
            assert axis["matrix"] is None
            turn = trimesh.transformations.rotation_matrix(1.0, axis["direction"], axis["point"])
        else:
            turn = np.array(axis["matrix"])
            assert np.trace(turn[:3, :3]) == pytest.approx(1 + 2 * np.cos(2 * np.pi / axis["order"]))
            assert np.allclose(turn[:3, :3] @ axis["direction"], axis["direction"])
            assert np.allclose(turn[:3, :3] @ axis["point"] + turn[:3, 3], axis["point"], atol=1e-9 * extent)
        assert symmetry_error(mesh, turn, scale) <= 1.5 * max_error


@pytest.mark.parametrize("mode", ["full", "paper"])
@pytest.mark.parametrize("name", MESHES)
def test_every_result_is_true_of_the_mesh(server: Server, data: Path, name: str, mode: str) -> None:
    path = data / name
    response = server.detect(name, path.read_bytes(), mode=mode)
    assert response.status_code == 200, response.text
    answer = response.json()
    mesh = load(path)
    assert answer["mesh"]["filename"] == name
    assert answer["mesh"]["format"] == path.suffix[1:]
    assert answer["mesh"]["faces"] == len(mesh.faces)
    check_answer(mesh, answer, MAX_ERROR)


@pytest.mark.parametrize("mode", ["full", "paper"])
def test_the_chair_has_its_mirror_plane(server: Server, data: Path, mode: str) -> None:
    answer = server.detect("chair.obj", (data / "chair.obj").read_bytes(), mode=mode).json()
    best = answer["planes"][0]
    assert angle_degrees(best["normal"], [1, 0, 0]) < 3
    assert abs(best["offset"]) < 0.02 * answer["frame"]["scale"]


def test_the_plant_has_no_symmetry(server: Server, data: Path) -> None:
    answer = server.detect("plant.off", (data / "plant.off").read_bytes()).json()
    assert (answer["planes"], answer["axes"], answer["point_group"]) == ([], [], "C1")


@pytest.mark.parametrize("extension", ["stl", "ply", "off", "glb", "gltf", "3mf"])
def test_the_format_does_not_change_the_answer(server: Server, data: Path, extension: str) -> None:
    mesh = load(data / "chair.obj")
    expected = server.detect("chair.obj", (data / "chair.obj").read_bytes()).json()
    answer = server.detect(f"chair.{extension}", as_file(mesh, extension)).json()
    assert answer["mesh"]["format"] == extension
    assert answer["point_group"] == expected["point_group"]
    assert len(answer["planes"]) == len(expected["planes"]) > 0
    for one, other in zip(answer["planes"], expected["planes"], strict=True):
        assert angle_degrees(one["normal"], other["normal"]) < 1
        assert one["offset"] == pytest.approx(other["offset"], abs=0.01)


@pytest.mark.parametrize("extension", ["glb", "gltf"])
def test_scene_transforms_give_world_coordinates(server: Server, data: Path, extension: str) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(load(data / "chair.obj"), transform=tilt())
    content = embedded_gltf(scene) if extension == "gltf" else scene.export(file_type="glb")
    answer = server.detect(f"scene.{extension}", content).json()
    world = scene.to_mesh()
    check_answer(world, answer, MAX_ERROR)
    assert angle_degrees(answer["planes"][0]["normal"], tilt()[:3, 0]) < 3
    assert symmetry_error(world, answer["planes"][0]["matrix"], answer["frame"]["scale"]) < MAX_ERROR


def test_units_of_the_file_do_not_matter(server: Server, data: Path) -> None:
    """A chair a thousand times as large, far from the origin: the same plane, in its own coordinates."""
    mesh = load(data / "chair.obj")
    mesh.apply_scale(1000)
    mesh.apply_translation([5000, 0, -3000])
    answer = server.detect("chair.obj", as_file(mesh, "obj")).json()
    check_answer(mesh, answer, MAX_ERROR)
    best = answer["planes"][0]
    assert angle_degrees(best["normal"], [1, 0, 0]) < 3
    assert best["normal"] @ np.array(best["point"]) == pytest.approx(-best["offset"])


def test_max_error_is_obeyed(server: Server, data: Path) -> None:
    content = (data / "vase.ply").read_bytes()
    loose = server.detect("vase.ply", content, max_error=1e-2).json()
    strict = server.detect("vase.ply", content, max_error=1e-12).json()
    check_answer(load(data / "vase.ply"), loose, 1e-2)
    assert all(plane["symmetry_error"] <= 1e-12 for plane in strict["planes"])
    assert len(strict["planes"]) <= len(loose["planes"])


def test_bop_lists_the_symmetries_as_matrices(server: Server, data: Path) -> None:
    mesh = load(data / "table.glb")
    answer = server.detect("table.glb", (data / "table.glb").read_bytes(), include=["bop", "rejected"]).json()
    for flat in answer["bop"]["symmetries_discrete"]:
        matrix = np.array(flat).reshape(4, 4)
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)  # rigid motions: a pose cannot be mirrored
        assert symmetry_error(mesh, matrix, answer["frame"]["scale"]) <= 1.5 * MAX_ERROR
    assert all(candidate["symmetry_error"] >= 0 for candidate in answer["rejected"])


@pytest.mark.skipif(shutil.which("curl") is None, reason="needs curl")
def test_the_documented_curl_command(server: Server, data: Path) -> None:
    command = ["curl", "-sS", "--fail-with-body", "-F", "file=@chair.obj", f"{server.url}/detect"]
    result = subprocess.run(command, cwd=data, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert '"planes":[{' in result.stdout.replace(" ", "")
