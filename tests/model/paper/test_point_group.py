"""The symbol of the group that the found elements generate."""

import numpy as np
import pytest

from model.paper.point_group import point_group

NONE = np.zeros((0, 3))
X, Y, Z = np.eye(3)


def around_z(degrees: float) -> np.ndarray:
    return np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees)), 0.0])


@pytest.mark.parametrize(
    ("normals", "axes", "symbol"),
    [
        ([], [], "C1"),
        ([X], [], "Cs"),
        ([X, Y], [], "C2v"),
        ([X, around_z(60)], [], "C3v"),
        ([X, around_z(120)], [], "C3v"),
        ([X, -around_z(45)], [], "C4v"),
        ([X, around_z(72)], [], "C5v"),
        ([X, Y, Z], [], "D2h"),
        ([X, around_z(60), Z], [], "D3h"),
        ([Z, X, around_z(45)], [], "D4h"),
        ([X, around_z(60), around_z(120)], [], "C3v"),
        ([X, around_z(45), Y], [], "C4v"),
        ([X + Y, Y + Z, X - Y], [], "Td"),
        ([X, Y + Z, X + Y], [], "Oh"),
        ([], [Z], "Cinfv"),
        ([X, Y], [Z], "Cinfv"),
        ([X, Z], [Z], "Dinfh"),
        ([X, Y, Z], [X, Y, Z], "Kh"),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_symbols(normals: list[np.ndarray], axes: list[np.ndarray], symbol: str, noise: float):
    rng = np.random.default_rng(0)
    rows = np.array(normals).reshape(-1, 3) + noise * rng.normal(size=(len(normals), 3))
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    assert point_group(rows, np.array(axes).reshape(-1, 3)) == symbol


def test_three_mirrors_of_an_icosahedron():
    golden = (1 + 5**0.5) / 2
    third = np.array([1.0, golden, 1 / golden]) / 2
    assert point_group(np.stack([X, Z, third]), NONE) == "Ih"
