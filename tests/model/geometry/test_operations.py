"""Symmetry operations in batches: isometries of the right kind, with the right fixed points."""

import numpy as np
import pytest

from model.geometry.operations import Operations
from model.geometry.transforms import reflect, rotation_matrix
from training.shapes.solids import random_rotation

RNG = np.random.default_rng(4)
POINTS = RNG.normal(size=(20, 3))


def unit(count: int) -> np.ndarray:
    vectors = RNG.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def some_of_each() -> Operations:
    inversion = Operations(unit(1), RNG.normal(size=(1, 3)), np.array([np.pi]), np.array([True]))
    rotoreflection = Operations(unit(1), RNG.normal(size=(1, 3)), np.array([np.pi / 3]), np.array([True]))
    planes = np.column_stack([unit(2), RNG.normal(size=2)])
    rotations = Operations.rotations(unit(2), RNG.normal(size=(2, 3)), [np.pi, 0.7])
    return Operations.joined([Operations.reflections(planes), rotations, inversion, rotoreflection])


def test_reflections_and_rotations_are_what_their_names_say():
    plane = np.append(unit(1)[0], 0.3)
    mirrored = Operations.reflections(plane[None]).apply(POINTS)[0]
    np.testing.assert_allclose(mirrored, reflect(POINTS, plane), atol=1e-12)
    direction, point = unit(1)[0], np.array([0.1, 0.2, 0.3])
    turned = Operations.rotations(direction, point, 0.7).apply(POINTS)[0]
    np.testing.assert_allclose(turned, (POINTS - point) @ rotation_matrix(direction, 0.7).T + point, atol=1e-12)


def test_an_inversion_has_a_centre_and_no_direction():
    centre = np.array([[0.5, -0.2, 0.1]])
    for direction in unit(3):
        inversion = Operations(direction[None], centre, np.array([np.pi]), np.array([True]))
        np.testing.assert_allclose(inversion.apply(POINTS)[0], 2.0 * centre - POINTS, atol=1e-12)


def test_all_are_isometries_that_keep_their_point():
    operations = some_of_each()
    images = operations.apply(POINTS)
    gaps = np.linalg.norm(POINTS[:, None] - POINTS, axis=2)
    for k in range(len(operations)):
        np.testing.assert_allclose(np.linalg.norm(images[k][:, None] - images[k], axis=2), gaps, atol=1e-12)
        own = operations[[k]].apply(operations.points[[k]])[0]
        np.testing.assert_allclose(own, operations.points[[k]], atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(operations.matrices), np.where(operations.improper, -1.0, 1.0))


def test_planes_come_back_as_they_went_in():
    planes = np.column_stack([unit(4), RNG.normal(size=4)])
    np.testing.assert_allclose(Operations.reflections(planes).planes, planes, atol=1e-12)


def test_moving_the_element_conjugates_the_operation():
    operations = some_of_each()
    turn, shift = np.array([0.2, -0.1, 0.3]), np.array([0.05, 0.1, -0.2])
    angle = float(np.linalg.norm(turn))
    rotation = rotation_matrix(turn / angle, angle)
    count = len(operations)
    moved = operations.moved(np.tile(turn, (count, 1)), np.tile(shift, (count, 1)))
    there = moved.apply(POINTS @ rotation.T + shift)
    np.testing.assert_allclose(there, operations.apply(POINTS) @ rotation.T + shift, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_matrices_turn_with_the_direction(seed: int):
    rotation = random_rotation(np.random.default_rng(seed))
    operations = some_of_each()
    turned = Operations(
        operations.directions @ rotation.T, operations.points, operations.angles, operations.improper
    ).matrices
    np.testing.assert_allclose(turned, rotation @ operations.matrices @ rotation.T, atol=1e-12)
