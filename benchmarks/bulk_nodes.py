"""``prsnet bulk`` on a cluster of several nodes on this machine, one of which is killed half way.

    python benchmarks/bulk_nodes.py INPUT OUTPUT [--nodes 3] [--kill]

Needs the extra ``bulk``. Every node has one core; the one that is killed gets SIGKILL for all its processes as soon as
a first result file is there. Prints one line of JSON.
"""

import argparse
import json
import os
import secrets
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_gcs_server_port_wait_time_s", "120")  # on a busy machine
os.environ.setdefault("RAY_worker_register_timeout_seconds", "240")
os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}  # for all processes of this run

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))


def main() -> int:
    """Run it; the exit code is that of ``prsnet bulk``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("input")
    parser.add_argument("output", type=Path)
    parser.add_argument("--nodes", type=int, default=3)
    parser.add_argument("--kill", action="store_true")
    options = parser.parse_args()

    from ray.cluster_utils import Cluster

    from app.bulk.job import patient_start

    node = {"num_cpus": 1, "object_store_memory": 100 << 20}  # which holds names and counts only
    with patient_start():
        cluster = Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})
        others = [cluster.add_node(**node) for _ in range(options.nodes - 1)]
    began = time.perf_counter()
    killed_with = None
    try:
        command = [sys.executable, "-m", "app", "bulk", options.input, str(options.output)]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        process = subprocess.Popen([*command, "--address", cluster.address], env=environment)
        while options.kill and process.poll() is None:
            if parts := list(options.output.glob("*.parquet")):
                cluster.remove_node(others[0], allow_graceful=False)
                killed_with = len(parts)
                break
            time.sleep(0.05)
        code = process.wait()
    finally:
        cluster.shutdown()
    seconds = round(time.perf_counter() - began, 1)
    print(json.dumps({"nodes": options.nodes, "killed_with_parts": killed_with, "seconds": seconds, "exit_code": code}))
    return code


if __name__ == "__main__":
    sys.exit(main())
