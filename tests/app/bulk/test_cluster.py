"""``prsnet bulk`` as people run it: on a cluster that loses a machine, and a second time."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("ray", reason="the extra bulk is not installed")
from pyarrow import parquet

from tests.app.fakes import DATA

from .buckets import bucket

ROOT = Path(__file__).parents[3]


def environment() -> dict[str, str]:
    """With the credentials that `bucket` sets."""
    return os.environ | {"PYTHONPATH": str(ROOT)}


@pytest.mark.skipif("TEST_CLUSTER" not in os.environ, reason="takes minutes of two cores: make cluster runs it")
@pytest.mark.timeout(840)
def test_a_machine_lost_half_way_costs_no_row_and_doubles_none(tmp_path: Path) -> None:
    """Files come from an S3-compatible server; one of two machines is killed after the first result file."""
    chair = (DATA / "chair.obj").read_bytes()
    files = {f"{i:02}.obj": b"# %d\n" % i + chair for i in range(40)} | {"broken.ply": b"ply\nnonsense"}
    out = tmp_path / "out"
    with bucket() as s3:
        s3.put({f"meshes/{name}": data for name, data in files.items()})
        command = [sys.executable, "benchmarks/bulk_nodes.py", s3.uri("meshes"), str(out), "--nodes", "2", "--kill"]
        result = subprocess.run(
            command, cwd=ROOT, env=environment(), capture_output=True, text=True, timeout=540, check=False
        )
        assert result.returncode == 0, result.stdout + result.stderr
        told = json.loads(result.stdout.splitlines()[-1])
        assert 0 < told["killed_with_parts"] < len(list(out.glob("*.parquet")))
        rows = parquet.read_table(out).to_pylist()
        assert sorted(row["path"] for row in rows) == [f"s3://{s3.name}/meshes/{name}" for name in sorted(files)]
        assert [Path(row["path"]).name for row in rows if row["point_group"] != "Cs"] == ["broken.ply"]
        assert "unreadable-mesh" in result.stderr

        # a second run has nothing to do, and needs no cluster for it
        before = {path: path.stat().st_mtime_ns for path in out.iterdir()}
        command = [sys.executable, "-m", "app", "bulk", s3.uri("meshes"), str(out)]
        again = subprocess.run(
            command, cwd=ROOT, env=environment(), capture_output=True, text=True, timeout=100, check=False
        )
        assert again.returncode == 0, again.stderr
        assert "41 inputs, 0 of them without a row" in again.stderr
        assert {path: path.stat().st_mtime_ns for path in out.iterdir()} == before

        # and another question is not answered in the same folder
        other = subprocess.run(
            [*command, "--mode", "paper"], cwd=ROOT, env=environment() | {"COLUMNS": "300"},
            capture_output=True, text=True, timeout=100, check=False,
        )  # fmt: skip
        assert other.returncode == 2
        assert "not paper" in other.stderr
