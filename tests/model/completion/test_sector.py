"""Sectors and capped halves: what is cut out makes up the whole again, and is as closed as the whole is."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from model.completion.halving import halve
from model.completion.lids import lid
from model.completion.sector import Sector, cut_sector
from model.errors import DegenerateMeshError, NoAxisError
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import rotation_matrix
from model.meshes.mesh import Mesh
from model.types import FloatArray

RNG = np.random.default_rng(5)
TURN = rotation_matrix(np.array([2.0, -1.0, 3.0]) / np.sqrt(14.0), 0.7)
SHIFT = np.array([3.0, -5.0, 40.0])
DIRECTION = TURN @ np.array([0.0, 0.0, 1.0])


def outline(order: int, *, chiral: bool) -> FloatArray:
    """The rim of a gear, whose teeth lean to one side where it is chiral."""
    angles = 2.0 * np.pi / order * (np.arange(order)[:, None] + np.array([0.0, 0.2, 0.35 if chiral else 0.5, 0.7]))
    radii = np.tile([3.0, 3.0, 5.0, 5.0 if not chiral else 4.0], order)
    return radii[:, None] * np.stack([np.cos(angles.ravel()), np.sin(angles.ravel())], axis=1)


def gear(order: int, *, bore: float = 0.0, chiral: bool = False) -> Mesh:
    """A gear in general position, with a hole along its axis or without."""
    walls = trimesh.creation.extrude_triangulation(
        *triangulated(outline(order, chiral=chiral), bore, order), height=2.0
    )
    return Mesh.checked(walls.vertices @ TURN.T + SHIFT, walls.faces)


def triangulated(rim: FloatArray, bore: float, order: int) -> tuple[FloatArray, FloatArray]:
    import mapbox_earcut

    rings = [rim]
    if bore:
        angles = 2.0 * np.pi * np.arange(8 * order) / (8 * order)
        rings.append(bore * np.stack([np.cos(angles), np.sin(angles)], axis=1)[::-1])
    points, ends = np.concatenate(rings), np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    return points, mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3).astype(np.int64)


def volume(vertices: FloatArray, faces: FloatArray) -> float:
    # About a point that is in no cut, so that faces there count too.
    a, b, c = np.moveaxis((vertices - SHIFT - [1.0, 2.0, 3.0])[faces], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def uncut_area(sector: Sector) -> float:
    """Of the faces that are not in a cut."""
    corners = sector.vertices[sector.faces]
    lying = np.zeros(len(corners), dtype=bool)
    for plane in sector.planes:
        lying |= (np.abs(corners @ plane[:3] + plane[3]) < 1e-4).all(axis=1)
    return Mesh(sector.vertices, sector.faces[~lying]).area


@pytest.mark.parametrize("capped", [True, False])
@pytest.mark.parametrize(("order", "parts"), [(2, 2), (3, 3), (5, 5), (12, 12), (12, 4), (12, 2), (40, 40)])
@pytest.mark.parametrize("bore", [0.0, 1.0])
def test_copies_of_a_sector_are_the_whole(order: int, parts: int, bore: float, capped: bool) -> None:
    mesh = gear(order, bore=bore, chiral=order % 2 == 1)
    sector = cut_sector(mesh, DIRECTION, SHIFT, parts, capped=capped)
    assert sector.capped == capped
    assert mesh.watertight
    assert Mesh(sector.vertices, sector.faces).watertight == capped
    if capped:
        assert parts * volume(sector.vertices, sector.faces) == pytest.approx(
            volume(mesh.vertices, mesh.faces), rel=1e-6
        )
    assert parts * uncut_area(sector) == pytest.approx(mesh.area, rel=1e-5)
    # Every point of the mesh is on a copy, and every copy's own surface on the mesh.
    turns = [rotation_matrix(DIRECTION, 2.0 * np.pi * k / parts) for k in range(parts)]
    copies = np.concatenate([(sector.vertices - SHIFT) @ turn.T for turn in turns])
    faces = np.concatenate([sector.faces + k * len(sector.vertices) for k in range(parts)]).astype(np.int32)
    _, squared, _ = SurfaceIndex(copies, faces).closest(np.ascontiguousarray(mesh.vertices - SHIFT))
    assert np.sqrt(squared.max()) < 1e-4
    # All of it is between the cuts, one of which turns into the other.
    heights = sector.vertices @ sector.planes[:, :3].T + sector.planes[:, 3]
    if parts > 2:
        assert heights.min() > -1e-4
    assert_allclose(turns[1] @ sector.planes[0, :3], -sector.planes[1, :3], atol=1e-12)
    assert_allclose(sector.planes[:, :3] @ DIRECTION, 0.0, atol=1e-12)
    # The ends of the axis are those of the mesh.
    assert_allclose((sector.ends - SHIFT) @ DIRECTION, [0.0, 2.0], atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.1, np.pi / 6.0, 1.0])
def test_the_first_cut_goes_where_it_is_told(angle: float) -> None:
    start = TURN @ np.array([np.cos(angle), np.sin(angle), 0.5])
    sector = cut_sector(gear(6), DIRECTION, SHIFT, 6, start=start)
    across = start - (start @ DIRECTION) * DIRECTION
    assert_allclose(sector.planes[0, :3] @ across, 0.0, atol=1e-12)
    lid_points = sector.vertices[np.abs(sector.vertices @ sector.planes[0, :3] + sector.planes[0, 3]) < 1e-9]
    assert ((lid_points - SHIFT) @ across).max() > 2.9
    with pytest.raises(NoAxisError):
        cut_sector(gear(6), DIRECTION, SHIFT, 6, start=DIRECTION)


def test_without_a_start_a_short_cut_is_found() -> None:
    sector = cut_sector(gear(6), DIRECTION, SHIFT, 6)
    for plane in sector.planes:
        lying = sector.vertices[np.abs(sector.vertices @ plane[:3] + plane[3]) < 1e-9]
        out = lying - SHIFT - np.outer((lying - SHIFT) @ DIRECTION, DIRECTION)
        assert np.linalg.norm(out, axis=1).max() < 3.1  # through a root, where teeth go to 5


def test_mirror_planes_are_cut_along_if_that_is_hardly_longer() -> None:
    roots = TURN @ np.array([-np.sin(0.1 * 2.0 * np.pi / 6.0), np.cos(0.1 * 2.0 * np.pi / 6.0), 0.0])
    sector = cut_sector(gear(6), DIRECTION, SHIFT, 6, mirrors=[roots])
    assert abs(sector.planes[0, :3] @ roots) == pytest.approx(1.0, abs=1e-12)


def test_two_halves_of_one_cut_meet_in_the_axis() -> None:
    sector = cut_sector(gear(4), DIRECTION, SHIFT, 2)
    lying = (np.abs(sector.vertices[sector.faces] @ sector.planes[0, :3] + sector.planes[0, 3]) < 1e-9).all(axis=1)
    out = (sector.vertices[sector.faces[lying]] - SHIFT) @ np.cross(DIRECTION, sector.planes[0, :3])
    assert lying.sum() > 1
    assert ((out > -1e-9).all(axis=1) | (out < 1e-9).all(axis=1)).all()


def test_a_mesh_that_is_open_in_the_cut_stays_open() -> None:
    mesh = gear(6)
    torn = Mesh.checked(
        mesh.vertices, mesh.faces[(mesh.vertices[mesh.faces] @ DIRECTION).min(axis=1) < SHIFT @ DIRECTION + 1.9]
    )
    sector = cut_sector(torn, DIRECTION, SHIFT, 6)
    assert not sector.capped
    assert 6 * uncut_area(sector) == pytest.approx(torn.area, rel=1e-5)
    assert not halve(
        torn, np.append(DIRECTION[[1, 0, 2]] * [1, -1, 0], 0.0) / np.hypot(*DIRECTION[:2]), capped=True
    ).capped


def bodies(*parts: trimesh.Trimesh) -> Mesh:
    whole = trimesh.util.concatenate(parts)
    return Mesh.checked(whole.vertices @ TURN.T, whole.faces)


@pytest.mark.parametrize("height", [0.0, 0.3, -0.2])
def test_a_capped_half_is_closed_and_both_make_the_whole(height: float) -> None:
    outer, inner = trimesh.creation.icosphere(3, radius=2.0), trimesh.creation.icosphere(2, radius=1.0)
    inner.invert()  # a hollow
    beside = trimesh.creation.box((1.0, 1.0, 1.0), trimesh.transformations.translation_matrix([5.0, 0.0, 0.0]))
    core = trimesh.creation.box((0.3, 0.4, 0.7))
    mesh = bodies(outer, inner, beside, core)
    plane = np.append(DIRECTION, -height)
    halves = [halve(mesh, plane, positive=side, capped=True) for side in (True, False)]
    assert all(half.capped and Mesh(half.vertices, half.faces).watertight for half in halves)
    total = sum(Mesh(half.vertices, half.faces).to_trimesh().volume for half in halves)
    assert total == pytest.approx(mesh.to_trimesh().volume, rel=1e-9)
    lids = [
        Mesh(half.vertices, half.faces[(np.abs(half.vertices[half.faces] @ DIRECTION - height) < 1e-9).all(axis=1)])
        for half in halves
    ]
    assert lids[0].area == pytest.approx(lids[1].area, rel=1e-9)
    # A lid looks away from its half.
    for cover, sign in zip(lids, (-1.0, 1.0), strict=True):
        a, b, c = np.moveaxis(cover.vertices[cover.faces], 1, 0)
        assert np.cross(b - a, c - a).sum(axis=0) @ DIRECTION / 2.0 == pytest.approx(sign * cover.area, rel=1e-9)


def test_a_step_in_the_plane_is_no_part_of_the_upper_half() -> None:
    wide = trimesh.creation.box((4.0, 4.0, 2.0), trimesh.transformations.translation_matrix([0, 0, -1.0]))
    narrow = trimesh.creation.box((1.0, 1.0, 2.0), trimesh.transformations.translation_matrix([0, 0, 1.0]))
    mesh = bodies(wide, narrow)
    upper = halve(mesh, np.append(DIRECTION, 0.0), capped=True)
    assert upper.capped
    assert Mesh(upper.vertices, upper.faces).area == pytest.approx(10.0)
    lower = halve(mesh, np.append(DIRECTION, 0.0), positive=False, capped=True)
    assert Mesh(lower.vertices, lower.faces).area == pytest.approx(64.0)


def test_rings_that_touch_in_a_corner_are_two_regions() -> None:
    """Two square tubes that share one edge: four edges of the outline meet in a corner."""
    one = trimesh.creation.box((1, 1, 1), trimesh.transformations.translation_matrix([0.5, 0.5, 0]))
    other = trimesh.creation.box((1, 1, 1), trimesh.transformations.translation_matrix([-0.5, -0.5, 0]))
    half = halve(bodies(one, other), np.append(DIRECTION, 0.0), capped=True)
    assert half.capped
    assert Mesh(half.vertices, half.faces).area == pytest.approx(2.0 * (1.0 + 1.0 + 2.0))


def test_an_outline_that_crosses_itself_has_no_lid() -> None:
    """Other bodies that cross it are closed each alone: `test_overlapping.py`."""
    bow_tie = np.array([[0.0, 0.0], [3.0, 2.0], [3.0, 0.0], [0.0, 1.0]])
    rings = np.concatenate([np.column_stack([bow_tie, np.full(4, height)]) for height in (0.0, 2.0)])
    walls = [face for i in range(4) for face in ([i, (i + 1) % 4, 4 + i], [(i + 1) % 4, 4 + (i + 1) % 4, 4 + i])]
    mesh = Mesh.checked(rings @ TURN.T + SHIFT, [*walls, [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]])
    assert not halve(mesh, np.append(DIRECTION, -DIRECTION @ SHIFT - 1.0), capped=True).capped


def test_a_lid_has_the_corners_on_straight_edges() -> None:
    flat = trimesh.creation.box((2.0, 1.0, 1.0)).subdivide().subdivide()
    half = halve(Mesh.checked(flat.vertices, flat.faces), np.array([0.0, 0.0, 1.0, -0.1]), capped=True)
    assert half.capped
    assert Mesh(half.vertices, half.faces).watertight


def test_nothing_to_cut_is_told() -> None:
    with pytest.raises(DegenerateMeshError):
        halve(gear(5), np.append(DIRECTION, -1e6), capped=True)
    away = Mesh.checked(trimesh.creation.box().vertices + np.array([5.0, 0.1, 0.0]), trimesh.creation.box().faces)
    with pytest.raises(DegenerateMeshError):
        cut_sector(away, np.array([0.0, 0.0, 1.0]), np.zeros(3), 4, start=np.array([-1.0, 0.0, 0.0]))


def test_an_open_outline_has_no_lid() -> None:
    vertices = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.5, 0, 1.0]])
    assert lid(vertices, np.array([[0, 1, 2]], dtype=np.int32), np.array([0.0, 0, 1, 0]), 1e-9) is None
