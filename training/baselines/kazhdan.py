"""Kazhdan, Chazelle, Dobkin, Finkelstein and Funkhouser 2002: a reflective symmetry descriptor.

For every plane through the centre of mass, the distance of the shape from what is symmetric about it: with f the
Gaussian distance transform of its voxels and g f the reflected function, the squared L2 distance of f from (f + g f) /
2 is (|f|^2 - <f, g f>) / 2. The function is cut into concentric spheres, each expanded in spherical harmonics up to
degree L. A reflection in the plane with normal n is the half-turn about n followed by the inversion, so that

    <f, g f>(n) = sum over l, m, k of (-1)^(l + k) A^l_mk d^l_mk(2 theta) exp(i (k - m) phi),

with n at the spherical angles theta and phi, d^l Wigner's matrices and A^l_mk the sum over the spheres of conj(c_lm)
c_lk r^2: all spheres are one matrix, and phi is one FFT. The values of all planes take some ten milliseconds.

Parameters are the defaults of the authors' program: 64^3 voxels that hold twice the root-mean-square radius of the
shape, a Gaussian of 2.83 voxels, a grid of 64 x 64 directions. There every local minimum is reported. The grid is 2.8
by 5.6 degrees wide; `find_planes` moves each minimum to that of a quadratic through its neighbours, `kazhdan_grid`
does not.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import sph_legendre_p_all

from model.geometry.frames import inertia_frame
from model.types import AnyArray, FloatArray, IntArray
from training.baselines._directions import distinct_lines, fit_maximum, local_maxima
from training.baselines._volume import Volume, gaussian_volume

TITLE = "Kazhdan 2002, minima fitted"

RESOLUTION = 64
FALLOFF = float(np.sqrt(8.0))
"""Voxels."""

RADII = 2.0
"""Root-mean-square radii of the shape that the largest sphere holds."""

SPHERES = RESOLUTION // 2
DEGREES = RESOLUTION // 2
"""Harmonics of degree 0 to one less than this."""

_STEP = float(np.pi) / RESOLUTION
_NEIGHBOURHOOD = 2.3 * _STEP
"""Holds the eight neighbours on the equator of the grid, where azimuths are twice as far apart as polar angles; towards
its poles, where it is denser, more of them."""


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`."""
    return symmetry_minima(vertices, faces, fit=True)


def symmetry_minima(vertices: FloatArray, faces: IntArray, *, fit: bool) -> FloatArray:
    """The planes ``(k, 4)`` where the symmetry distance has a local minimum, the smallest first."""
    radius = RADII * float(np.sqrt(inertia_frame(vertices, faces)[1].sum()))
    volume = gaussian_volume(vertices, faces, RESOLUTION, radius, FALLOFF)
    tables = _tables()
    values = reflective_correlation(harmonics(volume, tables), tables).ravel()
    directions = tables.directions.reshape(-1, 3)
    upper = directions[:, 2] > 0  # n and -n are one plane
    directions, values = directions[upper], values[upper]
    best = np.flatnonzero(local_maxima(directions, values, _NEIGHBOURHOOD))
    best = best[np.argsort(-values[best], kind="stable")]
    best = best[distinct_lines(directions[best], _NEIGHBOURHOOD)]
    normals = directions[best]
    if fit:
        normals = np.array([fit_maximum(directions, values, row, _NEIGHBOURHOOD) for row in best])
    return np.column_stack([normals, np.zeros(len(normals))])


class Tables(NamedTuple):
    """What does not depend on the shape.

    ``nodes`` ``(s, t, p, 3)``: points of unit spheres times the radii ``(s,)``, which are shares of the largest sphere;
    ``legendre`` ``(L, 2 L - 1, t)``: normalised functions times weights of the quadrature; ``wigner`` ``(q, theta)``:
    the matrices d^l at the grid's angles, an entry a row, sorted by k - m; ``degree``, ``row``, ``column`` of each
    entry, ``starts`` of each difference; ``directions`` ``(theta, phi, 3)``.
    """

    nodes: FloatArray
    radii: FloatArray
    legendre: FloatArray
    wigner: FloatArray
    degree: AnyArray
    row: AnyArray
    column: AnyArray
    starts: AnyArray
    directions: FloatArray


def harmonics(volume: Volume, tables: Tables) -> AnyArray:
    """Coefficients ``(s, L, 2 L - 1)`` of the function on the spheres; column m holds order m, as Python counts."""
    values = volume.at(tables.nodes * volume.half)
    # Along phi a plain Fourier transform, along theta a quadrature that is exact for these degrees.
    orders = np.fft.fft(values, axis=2) * (2.0 * np.pi / values.shape[2])
    columns = np.r_[0:DEGREES, -DEGREES + 1 : 0]
    return np.einsum("lmt,stm->slm", tables.legendre, orders[:, :, columns])


def reflective_correlation(coefficients: AnyArray, tables: Tables) -> FloatArray:
    """<f, g f> for the reflection g in every plane whose normal is one of ``tables.directions``: ``(theta, phi)``."""
    weighted = coefficients * tables.radii[:, None, None]
    matrices = np.einsum("slm,slk->lmk", weighted.conj(), weighted)
    entries = matrices[tables.degree, tables.row, tables.column]
    entries = entries * np.where((tables.degree + tables.column) % 2 == 0, 1.0, -1.0)
    by_difference = np.add.reduceat(entries[:, None] * tables.wigner, tables.starts, axis=0)  # (4 L - 3, theta)
    spectrum = np.zeros((by_difference.shape[1], 2 * RESOLUTION), dtype=np.complex128)
    differences = np.arange(-2 * DEGREES + 2, 2 * DEGREES - 1)
    spectrum[:, differences] = by_difference.T
    # Twice as fine along phi as the grid, or the highest differences would alias; every second value is the grid's.
    return np.ascontiguousarray(np.real(np.fft.ifft(spectrum, axis=1))[:, ::2] * (2 * RESOLUTION))


@lru_cache(maxsize=1)
def _tables() -> Tables:
    cosines, weights = np.polynomial.legendre.leggauss(DEGREES)
    angles = np.arccos(cosines)
    around = 2.0 * np.pi * np.arange(RESOLUTION) / RESOLUTION
    radii = (np.arange(SPHERES) + 0.5) / SPHERES
    nodes = radii[:, None, None, None] * _points(angles, around)
    legendre = sph_legendre_p_all(DEGREES - 1, DEGREES - 1, angles)[0] * weights
    entries: list[tuple[AnyArray, ...]] = []
    grid: FloatArray = (np.arange(RESOLUTION, dtype=np.float64) + 0.5) * _STEP
    for degree in range(DEGREES):
        orders = np.arange(-degree, degree + 1)
        row, column = (part.ravel() for part in np.meshgrid(orders, orders, indexing="ij"))
        matrices = _wigner(degree, 2.0 * grid).reshape(len(grid), -1).T
        entries.append((np.full(len(row), degree), row, column, matrices))
    degree, row, column, wigner = (np.concatenate(part) for part in zip(*entries, strict=True))
    order = np.argsort(column - row, kind="stable")
    difference = (column - row)[order]
    starts = np.flatnonzero(np.r_[True, np.diff(difference) > 0])
    return Tables(
        nodes, radii, legendre, wigner[order], degree[order], row[order], column[order], starts, _points(grid, around)
    )


def _points(polar: FloatArray, around: FloatArray) -> FloatArray:
    """Unit vectors ``(t, p, 3)`` at polar angles ``(t,)`` and azimuths ``(p,)``."""
    theta, phi = np.meshgrid(polar, around, indexing="ij")
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _wigner(degree: int, angles: FloatArray) -> FloatArray:
    """Wigner's matrices d^l(angle) ``(a, 2 l + 1, 2 l + 1)``: exp(-i angle J_y) in the basis of J_z."""
    m = np.arange(-degree, degree)
    raising = np.diag(np.sqrt(degree * (degree + 1) - m * (m + 1.0)), -1)
    values, vectors = np.linalg.eigh((raising - raising.T) / 2j)
    phases = np.exp(-1j * angles[:, None] * np.round(values))
    return np.ascontiguousarray(np.real((vectors * phases[:, None, :]) @ vectors.conj().T))
