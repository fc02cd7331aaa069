"""``POST /detect`` with a detector whose answer is known: what goes in, and what comes out, to the digit."""

import json
import os
from typing import Any

import numpy as np
import pytest

from tests.app.fakes import FakeDetector, Serving

pytestmark = pytest.mark.anyio


async def test_answer_has_the_members_of_the_contract(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector) as (client, _):
        response = await client.post("/detect", files={"file": ("some/where/chair.obj", chair)})
    assert response.headers["content-type"] == "application/json"
    answer = response.json()
    assert set(answer) == {
        "planes", "axes", "point_group", "frame", "mesh", "model", "timings_ms", "warnings", "levels", "similar"
    }  # fmt: skip
    assert answer["mesh"]["filename"] == "chair.obj"
    assert answer["mesh"]["format"] == "obj"
    assert (answer["mesh"]["vertices"], answer["mesh"]["faces"]) == (120, 260)
    assert answer["frame"]["coordinates"] == "input"
    assert answer["model"] == {"name": "fake", "version": "0", "sha256": "f" * 64}
    assert answer["warnings"] == ["a warning"]
    assert [axis["order"] for axis in answer["axes"]] == [2, None]
    assert answer["axes"][1]["matrix"] is None
    assert answer["axes"][0]["matrix"][2] == [0, 0, 1, 0]
    timings = answer["timings_ms"]
    assert set(timings) == {"parse", "voxelize", "infer", "refine", "validate", "total"}
    assert (timings["voxelize"], timings["infer"], timings["validate"]) == (
        0.1,
        0.2,
        0.4,
    )  # the detector's own
    assert 0 < timings["parse"] < timings["total"]


async def test_matrix_maps_the_mesh_onto_itself_and_keeps_every_digit(
    serving: Serving, detector: FakeDetector, chair: bytes
) -> None:
    shifted = b"".join(
        b"v " + b" ".join(repr(float(x) + 1 / 3).encode() for x in line.split()[1:]) + b"\n"
        if line.startswith(b"v ")
        else line + b"\n"
        for line in chair.splitlines()
    )
    vertices = np.array([line.split()[1:] for line in shifted.splitlines() if line.startswith(b"v ")], dtype=float)
    async with serving(detector) as (client, _):
        response = await client.post("/detect", files={"file": ("chair.obj", shifted)})
    plane = response.json()["planes"][0]
    center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    assert plane["offset"] == -center[0]
    assert plane["point"] == center.tolist()
    matrix = np.array(plane["matrix"])
    mirrored = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    distances = np.linalg.norm(mirrored[:, None] - vertices[None], axis=2).min(axis=1)
    assert distances.max() < 1e-7
    assert "-0.0," not in response.text


async def test_options_reach_the_detector(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector) as (client, _):
        await client.post("/detect", files={"file": ("chair.obj", chair)})
        await client.post("/detect?mode=paper&max_error=1e-3", files={"file": ("chair.obj", chair)})
    assert [(call["mode"], call["max_error"]) for call in detector.calls] == [("full", 4e-4), ("paper", 1e-3)]


async def test_nothing_is_computed_in_the_server(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector) as (client, _):
        await client.post("/detect", files={"file": ("chair.obj", chair)})
    assert detector.calls[0]["pid"] != os.getpid()


async def test_rejected_and_bop_come_only_when_asked_for(
    serving: Serving, detector: FakeDetector, chair: bytes
) -> None:
    files = {"file": ("chair.obj", chair)}
    async with serving(detector) as (client, _):
        rejected = (await client.post("/detect?include=rejected", files=files)).json()
        bop = (await client.post("/detect?include=bop", files=files)).json()
        both = (await client.post("/detect?include=bop&include=rejected", files=files)).json()
    assert "bop" not in rejected
    assert "rejected" not in bop
    assert both["bop"] == bop["bop"]
    assert both["rejected"] == rejected["rejected"]
    plane, axis = rejected["rejected"]
    assert set(plane) == {"kind", "normal", "offset", "symmetry_error", "reason"}
    assert set(axis) == {"kind", "direction", "point", "symmetry_error", "reason"}
    half_turn, continuous = bop["axes"]
    assert bop["bop"]["symmetries_discrete"] == [[x for row in half_turn["matrix"] for x in row]]
    assert bop["bop"]["symmetries_continuous"] == [{"axis": continuous["direction"], "offset": continuous["point"]}]


@pytest.mark.parametrize("error", [float("nan"), float("inf"), -1.0])
async def test_a_number_json_cannot_hold_is_a_defect_not_an_answer(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any, error: float
) -> None:
    detector.symmetry_error = error
    async with serving(detector) as (client, _):
        response = await client.post("/detect", files={"file": ("chair.obj", chair)})
    assert_problem(response, "internal-error", 500)


async def test_mesh_limit_of_the_settings(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any
) -> None:
    async with serving(detector, max_faces=259) as (client, _):
        response = await client.post("/detect", files={"file": ("chair.obj", chair)})
        assert_problem(response, "mesh-too-large", 413)
    async with serving(detector, max_faces=260) as (client, _):
        assert (await client.post("/detect", files={"file": ("chair.obj", chair)})).status_code == 200


async def test_model_card(serving: Serving, detector: FakeDetector) -> None:
    detector.metadata = {"recipe": {"name": "default"}, "metrics": {"sde": 1e-5, "missing": float("nan")}}
    async with serving(detector, max_upload_bytes=12345) as (client, _):
        response = await client.get("/model")
    card = json.loads(response.text, parse_constant=pytest.fail)
    assert card["metadata"]["recipe"] == {"name": "default"}
    assert card["limits"]["max_upload_bytes"] == 12345
    assert "obj" in card["limits"]["formats"]
    assert card["sha256"] == detector.sha256
