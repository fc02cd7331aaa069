"""`training evaluate`: how accurate, complete and fast methods are, side by side on the same shapes.

Every shape is posed and damaged (`corruptions`), shown to every method (`registry`), and the answers are matched
against what is known of the intact shape (`judging`, `matching`). Errors are exact distances on samples no method has
seen. `report` turns the records into tables.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model.errors import PRSNetError
from model.geometry.frames import UnitFrame
from model.paper.validation import MAX_ERROR
from training.evaluation.corruptions import DAMAGES
from training.evaluation.judging import judge
from training.evaluation.recorded import RecordedPlanes, read_recorded
from training.evaluation.registry import DEFAULT_METHODS, build_all, expand, method_record
from training.evaluation.resuming import Kept
from training.layouts import SourceFile, find_meshes, parse
from training.oracle.known_truth import truth_of, written_entry
from training.oracle.truth import Truth, load, named
from training.parallel import spread


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked of every shape.

    Attributes:
        damage: one of `training.evaluation.corruptions.DAMAGES`.
        methods: names of `training.evaluation.registry`.
        max_error: threshold on the SDE of methods that have one, and what counts as symmetric in the tables.
        seed: of poses, damage, and of the draw of shapes.
        symmetric: leave out shapes that are known to have no clear plane.
        words: leave out shapes whose name has none of these; empty: take all.
        recorded: a file of `training.evaluation.recorded`, empty for none: its planes are judged too, and shapes that
            it does not name are left out. Only for whole shapes: damage ``clean`` or ``rotated``.
    """

    damage: str = "rotated"
    methods: tuple[str, ...] = DEFAULT_METHODS
    max_error: float = MAX_ERROR
    seed: int = 0
    symmetric: bool = False
    words: tuple[str, ...] = ()
    recorded: str = ""


@dataclass(frozen=True, slots=True)
class _Job:
    source: SourceFile
    index: int
    truth: Truth | None
    recorded: Mapping[str, RecordedPlanes]
    methods: tuple[str, ...]
    options: Options


def evaluate(
    folders: Sequence[Path],
    options: Options,
    *,
    limit: int | None = None,
    ground_truth: Path | None = None,
    workers: int = 1,
    resume: Path | None = None,
    renew: Sequence[str] = (),
    progress: bool = True,
    only: Callable[[str], bool] | None = None,
) -> list[dict[str, Any]]:
    """Judge the methods on the meshes below ``folders``.

    Args:
        folders: searched by `training.layouts.find_meshes`. A ``ground_truth.json`` that `training shapes` wrote beside
            the meshes is used.
        options: what to do.
        limit: judge so many shapes, drawn at random.
        ground_truth: file of `training groundtruth`; shapes it does not know are searched on the spot, seconds each.
        workers: processes.
        resume: a file that takes every record as soon as it is made; what it holds of an earlier call with the same
            options, whatever its methods were, is not judged again.
        renew: of these methods it is, where the answers are of another revision of the code.
        progress: show a bar.
        only: says of a name whether the shape may be judged; None: every shape may.

    Returns:
        one record of plain values a shape, sorted by name (`training.evaluation.judging.judge`); those that could not
        be read say ``skipped``.

    Raises:
        ValueError: nothing to judge, or an option is out of range.
    """
    asked = {name: method_record(name) for name in expand(options.methods)}
    if options.damage not in DAMAGES:
        raise ValueError(f"damage is one of {', '.join(DAMAGES)}, not {options.damage!r}")
    recorded = read_recorded(Path(options.recorded)) if options.recorded else {}
    if recorded and options.damage not in ("clean", "rotated"):
        raise ValueError("recorded planes are those of whole shapes: damage is clean or rotated")
    sources = [pair for pair in enumerate(find_meshes(folders)) if only is None or only(pair[1].name)]
    known = {} if ground_truth is None else named(load(ground_truth), [source.name for _, source in sources])
    sources = _drawn(sources, options, known, recorded, limit)
    kept = Kept(resume, asdict(options), asked, renew)
    jobs = [
        _Job(source, index, known.get(source.name), recorded.get(source.name, {}), missing, options)
        for index, source in sources
        if (missing := kept.missing(source.name))
    ]
    jobs.sort(key=lambda job: job.methods)  # methods are built once for all jobs in a row that ask for the same ones
    for record in tqdm(spread(_judge_file, jobs, workers, chunk=2), total=len(jobs), unit="mesh", disable=not progress):
        kept.add(record)
    programs = dict.fromkeys(f"recorded {program}" for of in recorded.values() for program in of)
    return kept.listed({source.name for _, source in sources}, tuple(programs))


def _drawn(
    sources: list[tuple[int, SourceFile]],
    options: Options,
    known: Mapping[str, Truth],
    recorded: Mapping[str, Any],
    limit: int | None,
) -> list[tuple[int, SourceFile]]:
    """The shapes to judge, each with its place among all, which decides its pose."""
    if options.words:
        sources = [pair for pair in sources if any(word in pair[1].name for word in options.words)]
    if recorded:
        sources = [pair for pair in sources if pair[1].name in recorded]
    if options.symmetric:
        sources = [pair for pair in sources if _may_be_symmetric(pair[1], known)]
    if not sources:
        raise ValueError("no shape below the folders given is one of those asked for")
    if limit is None or limit >= len(sources):
        return sources
    rows = np.random.default_rng(options.seed).permutation(len(sources))[:limit]
    return [sources[row] for row in sorted(rows)]


def _may_be_symmetric(source: SourceFile, known: Mapping[str, Truth]) -> bool:
    entry = written_entry(source.path)
    if entry is not None:
        return bool(entry["planes"]) or any(axis["order"] is None for axis in entry["axes"])
    return source.name not in known or len(known[source.name].clear_planes()) > 0


def _judge_file(job: _Job) -> dict[str, Any]:
    head = {"name": job.source.name, "source": job.source.category or job.source.source}
    options = job.options
    try:
        mesh = parse(job.source.path.read_bytes(), job.source.path.name)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        truth, group = truth_of(job.source.path, mesh, frame, job.truth)
    except (PRSNetError, OSError) as error:
        return head | {"skipped": str(error)}
    if options.symmetric and not len(truth.clear_planes()):
        return head | {"skipped": "it has no clear plane"}
    methods = build_all(job.methods, options.max_error)
    seed = options.seed, job.index
    return head | {"group": group} | judge(mesh, truth, options.damage, seed, methods, job.recorded)
