"""One case of `benchmarks/performance.py`, in a process of its own: `python performance_cases.py SHAPE FACES ...`.

Alone in its process, because the most memory a process has used never falls again. Prints one JSON object.
"""

import argparse
import json
import os
import resource
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

from app.threads import ONE_THREAD

os.environ.update(ONE_THREAD)  # before numpy is imported, which reads it

import numpy as np

from app.outputs.registry import MESH_WRITERS
from benchmarks.meshes import SHAPES
from model import Detector, MeshError, read_mesh
from model.geometry.frames import UnitFrame
from model.geometry.surface import SurfaceIndex
from model.types import FloatArray, IntArray

FORMATS = ("obj", "stl", "ply", "glb")
_ORACLE_FACES = 5_000
_QUERIES = 20_000
_LONGEST_S = 240


def median_ms(action: Callable[[], object], repeats: int) -> float:
    """Median wall-clock milliseconds of a call after one to warm up."""
    action()
    spent: list[float] = []
    for _ in range(repeats):
        began = time.perf_counter()
        action()
        spent.append(time.perf_counter() - began)
    return 1e3 * float(np.median(spent))


def peak() -> int:
    """The most bytes this process has had in memory."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def parsing(files: dict[str, bytes], repeats: int) -> dict[str, Any]:
    """Milliseconds of `read_mesh` and of trimesh, by format."""
    import io

    import trimesh

    found: dict[str, Any] = {}
    for name, data in files.items():
        ours = median_ms(lambda data=data, name=name: read_mesh(data, f"mesh.{name}"), repeats)
        theirs = median_ms(
            lambda data=data, name=name: trimesh.load_mesh(io.BytesIO(data), file_type=name, process=False), repeats
        )
        found[name] = {"bytes": len(data), "ms": ours, "trimesh_ms": theirs}
    return found


def detection(detector: Detector, data: bytes, repeats: int) -> dict[str, Any]:
    """Medians of the stages in both modes, from bytes to symmetries; bytes of memory a face above what was loaded."""
    detector.warm_up()
    base = peak()
    found: dict[str, Any] = {}
    for mode in ("full", "paper"):
        rows: list[dict[str, float]] = []
        for run in range(repeats + 1):
            began = time.perf_counter()
            mesh = read_mesh(data, "mesh.stl")
            parsed = time.perf_counter()
            try:
                result = detector.detect(mesh, mode=mode)
            except MeshError as error:
                return {"refused": f"{type(error).__name__}: {error}", "ms": 1e3 * (time.perf_counter() - began)}
            rows.append({"parse": 1e3 * (parsed - began), **result.timings_ms})
            found["point_group"] = result.point_group
            if run == 0 and mode == "full":
                found["peak_bytes_per_face"] = (peak() - base) / len(mesh.faces)
        found[mode] = {name: float(np.median([row[name] for row in rows[1:]])) for name in rows[0]}
        found[mode]["total"] += found[mode]["parse"]
    return found


def rivals(vertices: FloatArray, faces: IntArray, repeats: int) -> dict[str, float]:
    """Milliseconds of methods that answer less, and of closest points elsewhere."""
    from training.baselines import bounding_box, pca
    from training.oracle.groundtruth import find_symmetries

    rng = np.random.default_rng(0)
    unit = UnitFrame.of(vertices, faces).to_unit(vertices)
    found = {
        "pca": median_ms(lambda: pca.find_planes(unit, faces, rng), repeats),
        "bounding_box": median_ms(lambda: bounding_box.find_planes(unit, faces, rng), min(repeats, 3)),
    }
    if len(faces) <= _ORACLE_FACES:
        began = time.perf_counter()
        find_symmetries(unit, faces)
        found["oracle"] = 1e3 * (time.perf_counter() - began)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (_QUERIES, 3))
    found["closest_points"] = median_ms(lambda: SurfaceIndex(unit, faces).squared_distances(points), min(repeats, 3))
    try:
        import igl
    except ImportError:
        return found
    found["closest_points_libigl"] = median_ms(
        lambda: igl.point_mesh_squared_distance(points, unit, faces.astype(np.int64)), min(repeats, 3)
    )
    return found


def main() -> None:
    """Measure one case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shape", choices=sorted(SHAPES))
    parser.add_argument("faces", type=int)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--rivals", action="store_true")
    options = parser.parse_args()
    signal.alarm(_LONGEST_S)
    vertices, faces = SHAPES[options.shape](options.faces)
    data = MESH_WRITERS["stl"].file(vertices, faces)
    case: dict[str, Any] = {"shape": options.shape, "faces": len(faces)}
    case |= detection(Detector.load(), data, options.repeats)
    if options.rivals:
        case["parsing"] = parsing(
            {name: MESH_WRITERS[name].file(vertices, faces) for name in FORMATS}, min(options.repeats, 3)
        )
        case["rivals_ms"] = rivals(vertices, faces, options.repeats)
    json.dump(case, sys.stdout)


if __name__ == "__main__":
    main()
