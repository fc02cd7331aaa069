"""Clouds of extruded curves: the planes listed are those of the surface, and no others are."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from model.geometry.transforms import reflect
from training.shapes.clouds import FAMILIES, PERTURBATIONS, POINTS, draw_cloud


def far_images(points: np.ndarray, plane: np.ndarray) -> float:
    """The share of points whose image in a plane is farther from all points than 98 % of these are from each other."""
    tree = cKDTree(points)
    spacing = tree.query(points, 2)[0][:, 1]
    return float((tree.query(reflect(points, plane))[0] > np.quantile(spacing, 0.98)).mean())


@pytest.mark.parametrize("index", range(2 * len(FAMILIES)))
def test_the_planes_map_the_cloud_to_itself_and_others_do_not(index: int):
    cloud = draw_cloud(index)
    assert cloud.family == FAMILIES[index % len(FAMILIES)]
    assert cloud.points.shape == (POINTS, 3)
    np.testing.assert_allclose(np.linalg.norm(cloud.planes[:, :3], axis=1), 1.0)
    for plane in cloud.planes:
        assert far_images(cloud.points, plane) < 0.1
    # Half-way between two mirrors through the axis there is none.
    through = cloud.planes if cloud.is_cone else cloud.planes[:-1]
    if len(through) > 1:
        axis = np.cross(through[0, :3], through[1, :3])
        axis /= np.linalg.norm(axis)
        half = np.pi / 2.0 / len(through)
        normal = np.cos(half) * through[0, :3] + np.sin(half) * np.cross(axis, through[0, :3])
        centre = np.linalg.lstsq(through[:, :3], -through[:, 3], rcond=None)[0]
        assert far_images(cloud.points, np.append(normal, -normal @ centre)) > 0.2


def test_families_have_their_numbers_of_planes():
    many = [draw_cloud(index) for index in range(6 * len(FAMILIES))]
    across = {family: {len(c.planes) - (not c.is_cone) for c in many if c.family == family} for family in FAMILIES}
    assert across["egg_of_keplero"] == {1}
    for family in ("citrus", "lemniscate", "mouth", "ellipse"):
        assert across[family] == {2}
    assert across["astroid"] == across["square"] == {4}
    for family, possible in {"geometric_petal": {4, 6, 8}, "m_convexities": set(range(3, 9))}.items():
        assert across[family] <= possible
        assert len(across[family]) > 1
    assert {cloud.is_cone for cloud in many} == {True, False}


def test_perturbations_keep_shape_and_pose_and_do_what_they_say():
    clean = draw_cloud(3, seed=5)
    diagonal = np.linalg.norm(np.ptp(clean.points, axis=0))
    for name, how in PERTURBATIONS.items():
        cloud = draw_cloud(3, name, seed=5)
        np.testing.assert_array_equal(cloud.planes, clean.planes)
        assert len(cloud.points) == round(how.kept * POINTS)
        np.testing.assert_array_equal(draw_cloud(3, name, seed=5).points, cloud.points)
    np.testing.assert_array_equal(draw_cloud(3, "clean", seed=5).points, clean.points)
    uniform = draw_cloud(3, "uniform", seed=5).points - clean.points
    assert 0.0099 * diagonal < np.abs(uniform).max() <= 0.01 * diagonal
    gaussian = draw_cloud(3, "gaussian", seed=5).points - clean.points
    assert gaussian.std() == pytest.approx(0.005 * diagonal, rel=0.02)
    few = draw_cloud(3, "undersampled", seed=5).points
    assert {tuple(point) for point in few} < {tuple(point) for point in clean.points}
    assert not np.array_equal(draw_cloud(3, seed=6).points, clean.points)
    with pytest.raises(ValueError, match="perturbation is one of clean"):
        draw_cloud(0, "dirty")
