"""Prints constraints.txt: every distribution that prsnet with all its extras needs, at the installed version.

Left out are the local part of a version (``+cpu``: which build of torch is the installer's choice) and the
GPU libraries that one build of torch brings and another does not.
"""

import re
import tomllib
from importlib.metadata import distribution
from itertools import chain
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

GPU_ONLY = re.compile(r"nvidia-|triton|cuda-")


def pins(requirements: list[str]) -> dict[str, str]:
    """Return name and version of everything that the requirements reach, extras and markers considered."""
    found: dict[str, str] = {}
    walked: set[tuple[str, frozenset[str]]] = set()
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        requirement = waiting.pop()
        name, extras = canonicalize_name(requirement.name), frozenset(requirement.extras)
        if GPU_ONLY.match(name) or (name, extras) in walked:
            continue
        walked.add((name, extras))
        installed = distribution(name)
        found[name] = installed.version.split("+")[0]
        for other in map(Requirement, installed.requires or []):
            if other.marker is None or any(other.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
                waiting.append(other)
    return found


def main() -> None:
    """Walk from what pyproject.toml declares."""
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = [*project["dependencies"], *chain.from_iterable(project["optional-dependencies"].values())]
    print("# Tested versions, written by `make lock`: pip install -c constraints.txt")
    for name, version in sorted(pins(declared).items()):
        print(f"{name}=={version}")


if __name__ == "__main__":
    main()
