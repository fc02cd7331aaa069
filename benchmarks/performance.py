"""From bytes to symmetries: how long, and how much memory, by size, shape and format.

    make bench                                     a few minutes: up to 200,000 faces
    make bench ARGS='--faces 1000 1000000 2000000 --save'

In the library on one core: every stage, memory a face, and, for the solid, parsing beside trimesh, PCA, the oriented
bounding box, the exhaustive search and libigl's closest points (where it is installed) as ratios. Then whole
`POST /detect` over loopback with one worker and with two. Prints tables; with ``--save`` writes docs/performance.json
and the picture in docs/images.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from app.outputs.registry import MESH_WRITERS
from benchmarks.detect_http import measure, server
from benchmarks.meshes import SHAPES
from benchmarks.performance_cases import FORMATS

ROOT = Path(__file__).parents[1]
SAVED = ROOT / "docs" / "performance.json"
SHORT = (1_000, 4_500, 20_000, 200_000)
STAGES = ("parse", "voxelize", "infer", "refine", "validate", "total")
_REQUESTS_S = 3.0


def run_case(shape: str, faces: int, repeats: int) -> dict[str, Any]:
    """The case's figures, or why there are none."""
    command = [sys.executable, "-m", "benchmarks.performance_cases", shape, str(faces), "--repeats", str(repeats)]
    if shape == "solid":
        command.append("--rivals")
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"shape": shape, "faces": faces, "failed": done.stderr[-500:] or f"exit code {done.returncode}"}
    return json.loads(done.stdout)


def over_http(sizes: list[int], workers: int) -> list[dict[str, Any]]:
    """Milliseconds at the client and requests a second, by size and format, with a client a worker."""
    found: list[dict[str, Any]] = []
    with server(workers) as port:
        for faces in sizes:
            mesh = SHAPES["solid"](faces)
            for name in FORMATS:
                content = MESH_WRITERS[name].file(*mesh)
                if len(content) > 60_000_000:
                    continue  # beyond what an upload may be
                for mode in ("full", "paper"):
                    path, file = f"/detect?mode={mode}", f"mesh.{name}"
                    measure(port, path, file, content, workers, 2, time.monotonic() + _REQUESTS_S)
                    began = time.perf_counter()
                    clients = measure(port, path, file, content, workers, 200, time.monotonic() + _REQUESTS_S)
                    elapsed = time.perf_counter() - began
                    rows = [row for client in clients for row in client.rows]
                    times = [row["request"] for row in rows]
                    found.append(
                        {
                            "faces": len(mesh[1]), "format": name, "mode": mode, "workers": workers,
                            "p50_ms": float(np.percentile(times, 50)), "p99_ms": float(np.percentile(times, 99)),
                            "around_ms": float(np.median([row["request"] - row["total"] for row in rows])),
                            "per_s": len(rows) / elapsed,
                        }
                    )  # fmt: skip
    return found


def table(heading: list[str], rows: list[list[object]]) -> str:
    """A Markdown table."""
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in lines)


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def report(results: dict[str, Any]) -> str:
    """All tables."""
    cases = results["cases"]
    rows = [
        [case["shape"], f"{case['faces']:,}", *[case["full"][stage] for stage in STAGES], case["paper"]["total"],
         case["peak_bytes_per_face"], case["point_group"]]
        for case in cases if "full" in case
    ]  # fmt: skip
    parts = [table(["shape", "faces", *STAGES, "paper mode", "bytes a face", "group"], rows)]
    parts += [
        f"{case['shape']}, {case['faces']:,} faces: {case.get('refused') or case.get('failed')}"
        for case in cases
        if "full" not in case
    ]
    whole = [case for case in cases if "rivals_ms" in case]
    rows = [
        [f"{case['faces']:,}", name, case["parsing"][name]["ms"],
         case["parsing"][name]["bytes"] / case["parsing"][name]["ms"] / 1e6,
         case["parsing"][name]["trimesh_ms"] / case["parsing"][name]["ms"]]
        for case in whole for name in case["parsing"]
    ]  # fmt: skip
    parts.append(table(["faces", "format", "read, ms", "GB/s", "trimesh takes"], rows))
    rows = []
    for case in whole:
        times, total = case["rivals_ms"], case["full"]["total"]
        others = [times.get(name, np.nan) / total for name in ("pca", "bounding_box", "oracle")]
        libigl = times.get("closest_points_libigl", np.nan) / times["closest_points"]
        rows.append([f"{case['faces']:,}", total, *others, libigl])
    heading = ["faces", "full mode, ms", "PCA takes", "bounding box", "exhaustive search", "libigl's points: ours"]
    parts.append(table(heading, rows))
    columns = ["format", "mode", "workers", "p50_ms", "p99_ms", "around_ms", "per_s"]
    rows = [[f"{row['faces']:,}", *[row[name] for name in columns]] for row in results["http"]]
    heading = ["faces", "format", "mode", "workers", "p50, ms", "p99, ms", "around the worker", "requests/s"]
    parts.append(table(heading, rows))
    return "\n\n".join(parts)


def draw(results: dict[str, Any], path: Path) -> None:
    """Time by size: every stage of the solid, the other shapes' totals, and rivals."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), sharey=True)
    solid = [case for case in results["cases"] if case["shape"] == "solid" and "full" in case]
    sizes = [case["faces"] for case in solid]
    for stage in STAGES:
        left.loglog(sizes, [max(case["full"][stage], 1e-2) for case in solid], "o-", label=stage)
    left.set_title("full mode, solid, one core")
    for shape in SHAPES:
        rows = [case for case in results["cases"] if case["shape"] == shape and "full" in case]
        right.loglog([row["faces"] for row in rows], [row["full"]["total"] for row in rows], "o-", label=shape)
    for name, label in (("pca", "PCA"), ("bounding_box", "bounding box"), ("oracle", "exhaustive search")):
        rows = [case for case in solid if name in case["rivals_ms"]]
        right.loglog([row["faces"] for row in rows], [row["rivals_ms"][name] for row in rows], "x--", label=label)
    right.set_title("all shapes and rivals")
    for axes in (left, right):
        axes.set_xlabel("faces")
        axes.grid(True, which="major", alpha=0.3)
        axes.legend(fontsize=8)
    left.set_ylabel("ms")
    figure.tight_layout()
    figure.savefig(path, dpi=90)


def main() -> None:
    """Parse the command line, measure, print, save."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, nargs="+", default=list(SHORT), help="sizes of the solid")
    parser.add_argument("--shapes", nargs="*", default=sorted(SHAPES), choices=sorted(SHAPES))
    parser.add_argument(
        "--shape-faces", type=int, nargs="+", default=[4_500, 200_000], help="sizes of the other shapes"
    )
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2], help="servers measured (none: library alone)")
    parser.add_argument("--http-faces", type=int, nargs="*", default=[4_500, 200_000])
    parser.add_argument("--save", action="store_true", help="write docs/performance.json and its picture")
    options = parser.parse_args()
    results: dict[str, Any] = {"cores": os.cpu_count(), "cases": [], "http": []}
    for shape in options.shapes:
        for faces in options.faces if shape == "solid" else options.shape_faces:
            print(f"{shape}, {faces:,} faces ...", file=sys.stderr, flush=True)
            results["cases"].append(run_case(shape, faces, options.repeats))
            if options.save:  # what there is, should it be interrupted
                SAVED.write_text(json.dumps(results, indent=1) + "\n")
    for workers in options.workers:
        print(f"POST /detect, {workers} worker(s) ...", file=sys.stderr, flush=True)
        results["http"] += over_http(options.http_faces, workers)
    print(report(results))
    if options.save:
        SAVED.write_text(json.dumps(results, indent=1) + "\n")
        draw(results, ROOT / "docs" / "images" / "performance.png")


if __name__ == "__main__":
    main()
