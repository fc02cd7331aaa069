"""Ray Data hands pieces of work to actors, on this machine or on a cluster, and gives a lost machine's to others.

Rows do not travel: an actor writes those of a piece itself, in one file that is named after the piece, and only then
says that the piece is done. So a piece that has to be done again replaces its own file, a lost machine costs what it
was working on and nothing that it had finished, and no memory grows with the number of meshes.
"""

import logging
import os
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from typing import Any

from app.bulk.detecting import BulkDetector, Task
from app.bulk.locations import Input, Store
from app.bulk.plan import MOST_FILES, Piece, missing, pieces
from app.bulk.results import Part, Results
from app.problems import WORKER_LOST

_ray: Any = import_module("ray")
_ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",  # Ray tells nobody that it is used
    "RAY_BACKEND_LOG_LEVEL": "fatal",  # what goes wrong is told by rows, and by this module
    "RAY_gcs_server_port_wait_time_s": "120",  # a busy machine needs more than the 20 that Ray gives itself
    "RAY_worker_register_timeout_seconds": "240",  # and than these 60
}
_START_S = 180.0
_CORES_AN_ACTOR = 4
_OBJECT_STORE = 128 << 20  # only names and counts are in it
_AHEAD = 2  # pieces at a time an actor has: its workers need not wait while the last file of one is worked on


@dataclass(frozen=True, slots=True)
class Progress:
    """What has been done since the start: meshes, those of them without an answer, the share of the work."""

    meshes: int
    problems: int
    share: float


@dataclass(frozen=True, slots=True)
class Cluster:
    """What there is to compute with."""

    cores: int
    nodes: int
    actors: int
    cores_an_actor: int


@contextmanager
def connected(address: str | None, cores: int) -> Generator[Cluster]:
    """Ray on this machine with so many cores, or the cluster at an address.

    Raises:
        ConnectionError: there is no cluster there.
    """
    os.environ.update({name: value for name, value in _ENVIRONMENT.items() if name not in os.environ})
    # Ray asks for a token by itself, so that nobody else on the machine runs code here; it need not warn of that.
    logging.getLogger("ray._private.authentication").setLevel(logging.ERROR)
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.WARNING}
    local: dict[str, Any] = {"num_cpus": cores, "include_dashboard": False, "object_store_memory": _OBJECT_STORE}
    _initialise(quiet | (local if address is None else {"address": address}))
    try:
        counts = [int(node["Resources"].get("CPU", 0)) for node in _ray.nodes() if node["Alive"]]
        counts = [count for count in counts if count]
        if not counts:
            raise ConnectionError("no machine of the cluster has a core to give")
        each = min(_CORES_AN_ACTOR, *counts)
        yield Cluster(sum(counts), len(counts), sum(count // each for count in counts), each)
    finally:
        _ray.shutdown()


def _initialise(options: dict[str, Any]) -> None:
    """Start or find Ray.

    Raises:
        ConnectionError: it is not there.
    """
    try:
        with patient_start():
            _ray.init(**options)
    except Exception as error:  # Ray raises plain ones
        _ray.shutdown()
        raise ConnectionError(f"Ray does not start: {error}") from error


@contextmanager
def patient_start() -> Generator[None]:
    """Give Ray minutes to start a node, where it gives itself half of one, which a busy machine does not keep.

    No setting says so: what looks for the node is made to look for longer. Starting again instead would leave the
    processes of the first try running beside those of the second.
    """
    services: Any = import_module("ray._private.services")
    look = services.get_node

    def look_for_longer(*arguments: Any, **options: Any) -> Any:
        end = time.monotonic() + _START_S
        while True:
            try:
                return look(*arguments, **options)
            except RuntimeError:
                if time.monotonic() > end:
                    raise
            time.sleep(0.2)

    services.get_node = look_for_longer
    try:
        yield
    finally:
        services.get_node = look


def run(task: Task, inputs: list[Input], cluster: Cluster, on_progress: Callable[[Progress], None]) -> int:
    """Give every input that has no row one; the number of meshes that were worked on.

    Ray gives a lost machine's pieces to others by itself. What an actor failed on (it could not write, say) is tried
    once more, alone; an input on which even that fails gets a row that says so.

    Raises:
        OSError: the output cannot be read or written.
    """
    results = Results(Store(task.target))
    task = replace(task, settings={**task.settings, "workers": cluster.cores_an_actor})
    meshes = 0
    for most in (MOST_FILES, 1):
        left = missing(inputs, results.done())
        if left:
            meshes += _work(task, pieces(left, cluster.cores, most), cluster, on_progress)
    for item in missing(inputs, results.done()):
        _give_up(results, item)
    return meshes


def _work(task: Task, planned: list[Piece], cluster: Cluster, on_progress: Callable[[Progress], None]) -> int:
    """Have the pieces worked on, in whatever order; the number of meshes in them."""
    from ray.data import ActorPoolStrategy, DataContext

    context: Any = DataContext.get_current()
    context.enable_progress_bars = False
    context.max_errored_blocks = -1  # what fails is missing, and tried again
    logging.getLogger("ray.data").setLevel(logging.CRITICAL)
    actors = min(cluster.actors, len(planned))
    pool: Any = ActorPoolStrategy
    work = _ray.data.from_items([asdict(piece) for piece in planned], override_num_blocks=len(planned)).map_batches(
        BulkDetector,
        batch_size=None,
        batch_format="pyarrow",
        fn_constructor_args=[task],
        num_cpus=cluster.cores_an_actor,
        compute=pool(
            min_size=1,
            max_size=actors,
            initial_size=actors,
            max_concurrent_calls_per_actor=_AHEAD,
            max_tasks_in_flight_per_actor=_AHEAD,
            enable_true_multi_threading=True,
        ),
    )
    total = sum(piece.cost for piece in planned)
    meshes = problems = cost = 0
    for row in work.iter_rows():
        meshes, problems, cost = meshes + row["meshes"], problems + row["problems"], cost + row["cost"]
        on_progress(Progress(meshes, problems, cost / total))
    return meshes


def _give_up(results: Results, item: Input) -> None:
    detail = "What worked on it failed, alone as well; the log of the actor says why."
    part = Part(results.store, item.path)
    row = {"path": item.path, "shard": item.path if item.is_shard else None, "bytes": item.size}
    part.add(row | {"problem": WORKER_LOST.slug, "detail": detail})
    part.finish()
