"""A small file cannot ask for a large answer."""

from typing import Any

import pytest

from app.workers.jobs import perform
from app.workers.wire import Job
from model.errors import MeshTooLargeError
from tests.app.fakes import FakeDetector
from tests.model.mesh_files import XML_TETRAHEDRON, three_mf


def doubled(times: int) -> bytes:
    """One tetrahedron, ``2 ** times`` times, in a file that hardly grows."""
    objects = f"<object id='0'><mesh>{XML_TETRAHEDRON}</mesh></object>"
    for number in range(1, times + 1):
        twice = f"<component objectid='{number - 1}'/>" * 2
        objects += f"<object id='{number}'><components>{twice}</components></object>"
    return three_mf(objects, f"<item objectid='{times}'/>")


@pytest.mark.parametrize(("times", "fits"), [(4, True), (16, False)])
def test_a_file_of_a_kilobyte_becomes_no_answer_of_many_megabytes(times: int, fits: bool) -> None:
    data = doubled(times)
    assert len(data) < 2000
    limits: dict[str, Any] = {"max_vertices": 10**7, "max_faces": 10**7, "max_nodes": 10**6, "cpu_s": 60.0}
    job = Job(
        "many.3mf", "full", 4e-4, [], max_unpacked_bytes=1 << 20, size=len(data), transport="inline", geometry="stl",
        task="complete", plane=[1.0, 0.0, 0.0, 0.0], max_answer_bytes=1 << 28, **limits,
    )  # fmt: skip
    if fits:
        body = perform(FakeDetector(), job, data)[1]
        assert body
    else:
        with pytest.raises(MeshTooLargeError, match="of this size"):
            perform(FakeDetector(), job, data)
