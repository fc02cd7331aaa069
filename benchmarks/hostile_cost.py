"""Processor time of meshes that are made to be slow, and of sound ones that are large; prints Markdown.

    python benchmarks/hostile_cost.py [NAME...]

In one process, without HTTP: it is counted in processor seconds, which hardly depend on what else the machine does.
"""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

sys.path.insert(0, str(Path(__file__).parents[1]))

from model import Detector, Mesh, read_mesh
from model.completion.mirroring import complete
from model.errors import MeshError
from tests.hostile import CLASSES

HOSTILE = ("crossing", "slivers", "many", "coincident")
SLANTED = np.array([0.48, 0.6, 0.64, 0.0])


def polygon(corners: int) -> bytes:
    """One face of so many corners, as OBJ."""
    angles = 2.0 * np.pi * np.arange(corners) / corners
    rows = "".join(f"v {x:.9g} {0.7 * y:.9g} 0\n" for x, y in zip(np.cos(angles), np.sin(angles), strict=True))
    return (rows + "f " + " ".join(map(str, range(1, corners + 1))) + "\n").encode()


def prism(radii: np.ndarray, hub: bool) -> Mesh:
    """A polygon of so many corners with these distances from the axis, extruded; caps from one corner or a centre."""
    count = len(radii)
    angles = 2.0 * np.pi * np.arange(count) / count
    ring = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    rings = [np.column_stack([ring, np.full(count, z)]) for z in (-0.1, 0.1)]
    vertices = np.concatenate([*rings, [[0.0, 0.0, -0.1], [0.0, 0.0, 0.1]]])
    here = np.arange(count)
    after = (here + 1) % count
    sides = [np.stack([here, after, after + count], 1), np.stack([here, after + count, here + count], 1)]
    if hub:
        caps = [np.stack([after, here, 0 * here + 2 * count], 1)]
        caps += [np.stack([here + count, after + count, 0 * here + 2 * count + 1], 1)]
    else:
        corner = here[1:-1]
        caps = [np.stack([0 * corner, corner + 1, corner], 1), np.stack([0 * corner, corner, corner + 1], 1) + count]
    return Mesh.checked(vertices, np.concatenate([*sides, *caps]).astype(np.int32))


def sound() -> Iterator[tuple[str, Mesh]]:
    """Large meshes that are what they seem."""
    teeth = np.where(np.arange(8000) // 125 % 2 == 0, 1.0, 0.85)
    yield "gear, 64 teeth", prism(teeth, hub=True)
    for corners in (360, 5000, 50_000):
        yield f"prism of {corners:,} corners", prism(np.ones(corners), hub=False)
    torus = trimesh.creation.torus(1.0, 0.3, major_sections=450, minor_sections=225)
    yield "torus", Mesh.checked(torus.vertices, torus.faces)


def spent(work: Callable[[], Any]) -> str:
    """Processor seconds, and whether it was refused, or cut short."""
    began = time.process_time()
    try:
        result = work()
        cut = any("cut short" in warning for warning in getattr(result, "warnings", ()))
        how = ", cut short" if cut else ""
    except MeshError as error:
        how = f", {type(error).__name__}"
    return f"{time.process_time() - began:.2f}{how}"


def main() -> None:
    """Measure, reading included, and print two tables."""
    wanted = sys.argv[1:]
    detector = Detector.load()
    detector.warm_up()
    complete(prism(np.ones(100), hub=False), SLANTED)
    files = [(name, data) for kind in HOSTILE for name, data in CLASSES[kind](1.0)]
    read_mesh(polygon(8), "polygon.obj")
    print("| file | MB | full mode, s | paper mode, s |\n| --- | --- | --- | --- |")
    polygons = [(f"polygon{corners}.obj", polygon(corners)) for corners in (100_000, 1_000_000)]
    for name, data in [*files, *polygons]:
        if (wanted and name not in wanted) or name == "point.stl":  # refused as it is read
            continue
        modes = [
            spent(lambda mode=mode, name=name, data=data: detector.detect(read_mesh(data, name), mode=mode))
            for mode in ("full", "paper")
        ]
        print(f"| {name} | {len(data) / 1e6:.2f} | {' | '.join(modes)} |", flush=True)
    if wanted:
        return
    print("\n| mesh | faces | `/complete`, s | about a slanted plane, s | full mode, s |\n" + "| --- " * 5 + "|")
    for name, mesh in sound():
        planes = (np.array([0.0, 0.0, 1.0, 0.0]), SLANTED)
        times = [spent(lambda plane=plane, mesh=mesh: complete(mesh, plane)) for plane in planes]
        times.append(spent(lambda mesh=mesh: detector.detect(mesh)))
        print(f"| {name} | {len(mesh.faces):,} | {' | '.join(times)} |", flush=True)


if __name__ == "__main__":
    main()
