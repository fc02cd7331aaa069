"""Polygons of every outline become triangles that cover them: no more, no less, and no gap to their neighbours."""

import numpy as np
import pytest

from model.errors import MeshTooLargeError
from model.formats import read_mesh
from model.formats._common import Limits
from model.formats._polygons import triangulate

STAR = [(np.cos(t) * r, np.sin(t) * r) for t, r in zip(np.pi * np.arange(10) / 5, [10, 4] * 5, strict=True)]
U = [(0, 0), (12, 0), (12, 10), (8, 10), (8, 4), (4, 4), (4, 10), (0, 10)]
DART = [(0, 0), (4, 4), (0, 1), (-4, 4)]
NOTCHED = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 3), (2, 1), (1, 3), (0, 3), (0, 2), (0, 1)]  # corners on straight edges
# A square with a square hole, joined by an edge that is walked in both directions.
PINCHED = [(0, 0), (9, 0), (9, 9), (0, 9), (0, 0), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3)]
OUTLINES = {"star": STAR, "u": U, "dart": DART, "notched": NOTCHED, "pinched": PINCHED}


def shoelace(outline):
    x, y = np.array(outline, dtype=float).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def areas_of(vertices, faces):
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a) / 2.0


def placed(outline, seed):
    """The outline in space, turned and far from the origin, with its unit normal."""
    rng = np.random.default_rng(seed)
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    frame[2] *= np.sign(np.linalg.det(frame))
    return np.array(outline, dtype=float) @ frame[:2] + 100.0, frame[2]


@pytest.mark.parametrize("name", OUTLINES)
@pytest.mark.parametrize("start", range(3))
@pytest.mark.parametrize("reverse", [False, True])
def test_a_polygon_is_covered_once_and_keeps_its_orientation(name, start, reverse):
    outline = np.roll(np.array(OUTLINES[name], dtype=float), start, axis=0)[:: -1 if reverse else 1]
    points, normal = placed(outline, start)
    done = triangulate(points, np.arange(len(points)), np.array([len(points)]), Limits())
    along = areas_of(points, done.faces) @ normal
    area = shoelace(outline)
    assert (along * np.sign(area) > -1e-9).all()
    assert along.sum() == pytest.approx(area, rel=1e-9)
    assert done.crossing == 0
    assert len(done.faces) == len(points) - 2
    assert np.array_equal(np.arange(len(points))[done.places], done.faces)


TONGUE = [(0, 0), (2, 0), (2, 1), (3, 1), (2, 1), (2, 2), (0, 2)]  # an edge out and back
DETOUR = [(0, 0), (2, 0), (3, 0), (2, 0), (2, 2), (1, 1), (0, 2)]  # the same along an edge
TWICE = [(0, 0), (0, 0), (3, 0), (3, 3), (1, 1), (1, 1), (0, 3), (0, 1)]  # corners that are told twice


@pytest.mark.parametrize("outline", [TONGUE, DETOUR, TWICE])
@pytest.mark.parametrize("seed", range(20))
def test_tongues_without_width_and_corners_told_twice_add_nothing_and_cost_nothing(outline, seed):
    points, normal = placed(np.roll(np.array(outline, dtype=float), seed, axis=0), seed)
    done = triangulate(points, np.arange(len(points)), np.array([len(points)]), Limits())
    along = areas_of(points, done.faces) @ normal
    assert (along > -1e-9).all()
    assert along.sum() == pytest.approx(shoelace(outline), rel=1e-9)
    assert done.crossing == 0


@pytest.mark.parametrize("name", OUTLINES)
def test_prisms_are_watertight_in_every_format_with_polygons(name):
    outline = OUTLINES[name]
    count = len(outline)
    points = [(x, y, z) for z in (0, 2) for x, y in outline]
    polygons = [list(range(count))[::-1], list(range(count, 2 * count))]
    polygons += [[i, (i + 1) % count, (i + 1) % count + count, i + count] for i in range(count)]
    if name == "pinched":  # the edge to the hole has no wall
        polygons = [walls for walls in polygons if not {4, 5} <= set(walls) or len(walls) > 4]
        polygons = [walls for walls in polygons if not {9, 0} <= set(walls) or len(walls) > 4]
    rows = "\n".join(" ".join(map(repr, map(float, point))) for point in points)
    lists = "\n".join(f"{len(polygon)} " + " ".join(map(str, polygon)) for polygon in polygons)
    obj = "".join(f"v {row}\n" for row in rows.split("\n"))
    obj += "".join("f " + " ".join(str(i + 1) for i in polygon) + "\n" for polygon in polygons)
    header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += f"element face {len(polygons)}\nproperty list uchar int vertex_indices\nend_header\n"
    files = {
        "a.obj": obj,
        "a.off": f"OFF\n{len(points)} {len(polygons)} 0\n{rows}\n{lists}\n",
        "a.ply": f"{header}{rows}\n{lists}\n",
    }
    for file, text in files.items():
        mesh = read_mesh(text.encode(), file)
        corners = mesh.vertices[mesh.faces]
        volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
        assert volume == pytest.approx(2 * shoelace(outline), rel=1e-9)
        assert mesh.watertight
        assert mesh.warnings == ()


@pytest.mark.parametrize(
    "outline",
    [
        [(0, 0), (2, 2), (2, 0), (0, 2)],  # a bow tie
        [(0, 0), (3, 2), (3, 0), (0, 1)],  # one of uneven halves
        [(np.cos(t), np.sin(t)) for t in 4 * np.pi * np.arange(5) / 5],  # a pentagram
        [(0, 0), (4, 0), (4, 3), (1, 3), (1, -1), (0, -1)],
    ],
)
def test_a_polygon_that_crosses_itself_is_told(outline):
    text = "".join(f"v {x} {y} 0\n" for x, y in outline) + "f " + " ".join(map(str, range(1, len(outline) + 1)))
    (warning,) = read_mesh(text.encode(), "a.obj").warnings
    assert warning.startswith("A polygon crosses its own outline")


def test_a_bent_quadrilateral_is_cut_along_its_shorter_diagonal_wherever_it_starts():
    points = np.array([[0.0, 0, 0], [3, 0, 1], [4, 4, 0], [0, 3, 1]])
    halves = set()
    for start in range(4):
        done = triangulate(np.roll(points, start, axis=0), np.arange(4), np.array([4]), Limits())
        back = (done.faces - start) % 4
        halves.add(frozenset(frozenset(face) for face in back.tolist()))
    assert halves == {frozenset({frozenset({0, 1, 3}), frozenset({1, 2, 3})})}


def test_a_rim_that_is_not_planar_is_covered_as_seen_from_the_front():
    outline = np.array(STAR)
    points = np.column_stack([outline, 0.3 * np.cos(np.arange(10))])
    done = triangulate(points, np.arange(10), np.array([10]), Limits())
    assert areas_of(points, done.faces)[:, 2].sum() == pytest.approx(shoelace(STAR))
    assert done.crossing == 0


def test_polygons_of_all_kinds_in_one_file_do_not_disturb_each_other():
    rng = np.random.default_rng(4)
    chosen = [list(OUTLINES.values())[i] for i in rng.integers(0, len(OUTLINES), 40)]
    chosen[5], chosen[17] = [(0, 0), (1, 0)], [(0, 0)]  # lines and points have no triangle
    points = np.concatenate([placed(outline, seed)[0] for seed, outline in enumerate(chosen)])
    lengths = np.array([len(outline) for outline in chosen])
    order = rng.permutation(len(points))
    where = np.argsort(order)
    done = triangulate(points[order], where, lengths, Limits())
    area = np.linalg.norm(areas_of(points[order], done.faces), axis=1).sum()
    assert area == pytest.approx(sum(abs(shoelace(outline)) for outline in chosen if len(outline) > 2))


def test_many_corners_are_no_problem_unless_they_are_concave():
    count = 30_000
    angles = 2 * np.pi * np.arange(count) / count
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
    done = triangulate(circle, np.arange(count), np.array([count]), Limits())
    assert areas_of(circle, done.faces)[:, 2].sum() == pytest.approx(np.pi, rel=1e-6)
    gear = circle * (1 + 0.1 * (np.arange(count) % 2))[:, None]
    with pytest.raises(MeshTooLargeError, match="concave"):
        triangulate(gear, np.arange(count), np.array([count]), Limits())


def test_a_polygon_of_a_million_corners_is_refused_before_anything_is_made_of_it():
    points = np.random.default_rng(0).normal(size=(10, 3))
    indices, lengths = np.arange(1_000_000) % 10, np.array([3, 1_000_000 - 3])
    with pytest.raises(MeshTooLargeError, match="more than 100000 corners; triangulate it"):
        triangulate(points, indices, lengths, Limits())
