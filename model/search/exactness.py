"""Whether a symmetry is exact: whether it holds everywhere on the surface, up to what the file itself can promise.

An RMS deviation over samples cannot see a missing screw. Here every vertex, edge and face is looked at, and each may
deviate by what its own shape leaves open: the resolution of the coordinates, and how far facets stray from the curved
surface they stand for (the sagitta). Two bores drawn with 12 and 16 segments are the same bore; a hole of a screw is
none of these.
"""

from dataclasses import dataclass

import numpy as np

from model._jit import kernel_array
from model.geometry.operations import Operations
from model.geometry.surface import SurfaceIndex
from model.geometry.topology import duplicate_vertex_map
from model.search._closure_kernels import connected
from model.search._resolution_kernels import extent_and_precision
from model.search.facets import Facets
from model.search.features import Features, Look
from model.search.hypothesis import Hypothesis
from model.symmetries import Patch
from model.types import BoolArray, FloatArray, IntArray

_RELATIVE = 1e-6
_CELL, _MOST_CELLS = 0.05, 100
"""Points that deviate nearer to each other than this, unit frame, are one patch."""

_MOST_PATCHES = 8
_MOST_CHECKED, _MOST_ELEMENTS, _ALL_LOOKED_AT = 400, 16, 3
_SAME_MATRIX = 1e-9
_SOME_VALUES, _MANY_VALUES = 20, 300
_FINE_STEP, _DRAWN_STEP = 1e-4, 0.005
"""Steps of a grid, as a part of the extent, that coordinates are drawn on by hand are larger; where there are many
values, so much larger."""

_SINGLE = 2.0**-23


class ExactnessTest:
    """Tests symmetries of one surface, unit frame, on all of its features.

    ``allowed``: distance, unit frame, that says nothing.

    Args:
        surface: its index.
        facets: its mesh, unit frame.
        resolution: of the coordinates, unit frame (`resolution_of`).
    """

    def __init__(self, surface: SurfaceIndex, facets: Facets, resolution: float) -> None:
        self.allowed = _RELATIVE + 2.0 * resolution
        self.features = Features(surface, facets, self.allowed)

    def exact(self, hypothesis: Hypothesis) -> "Verdict":
        """Test a group: by its generators, and where one does not hold by its elements, too."""
        generators = hypothesis.measured_operations if not len(hypothesis.matrices) else hypothesis.generators
        largest, looks = 0.0, list[Look]()
        others = hypothesis.elements[:_MOST_ELEMENTS]
        repeated = np.abs(others.matrices[:, None] - generators.matrices[None]).max((2, 3)) < _SAME_MATRIX
        others = others[~repeated.any(1)]
        # What an element lacks, one of the generators lacks too: of many elements, part of the faces will tell.
        for operations, stride in ((generators, 1), (others, max(1, len(others) // _ALL_LOOKED_AT))):
            for k in range(len(operations)):
                look = self.features.look(operations[[k]], stride)
                largest = max(largest, float(np.where(look.bad, 0.0, look.deviations).max()))
                looks += [look] if look.bad.any() else []
            if not looks:
                break
        points = np.concatenate([np.zeros((0, 3)), *(look.points[look.bad] for look in looks)])
        sagittas = np.concatenate([np.zeros(0), *(look.sagittas[look.bad] for look in looks)])
        once = np.unique(duplicate_vertex_map(points))
        return Verdict(self.features, hypothesis, points[once], sagittas[once], largest)


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What testing a group found: the points ``(m, 3)``, with ``sagittas`` ``(m,)``, where a generator does not hold.

    ``largest``: the largest deviation of all other points.
    """

    features: Features
    hypothesis: Hypothesis
    points: FloatArray
    sagittas: FloatArray
    largest: float

    @property
    def exact(self) -> bool:
        """Whether the group holds everywhere."""
        return not len(self.points)

    def of(self, operations: Operations) -> tuple[FloatArray, BoolArray]:
        """The largest deviation of each operation of the group, and which ones are exact: ``(k,)`` both."""
        largest, fits = np.full(len(operations), self.largest), np.ones(len(operations), dtype=np.bool_)
        if not self.exact:
            points, sagittas = self._thinned(_MOST_CHECKED)
            for k in range(len(operations)):
                look = self.features.measure(points, sagittas, operations[[k]])
                largest[k], fits[k] = max(self.largest, float(look.deviations.max())), not look.bad.any()
        return largest, fits

    def _thinned(self, most: int) -> tuple[FloatArray, FloatArray]:
        stride = -(-len(self.points) // most)
        return self.points[::stride], self.sagittas[::stride]

    def patches(self) -> list[Patch]:
        """What breaks the group: the fewest places that account for all deviations, the largest first.

        A point x deviates because something stands there that T(x) lacks, or because something lacks at T(x): of a
        missing screw all others tell the same place. The place that accounts for most is taken first.
        """
        if self.exact:
            return []
        elements = self.hypothesis.measured_operations
        elements = elements[:: -(-len(elements) // _MOST_ELEMENTS)]
        points, sagittas = self._thinned(_MOST_CHECKED)
        looks = [self.features.measure(points, sagittas, elements[[k]]) for k in range(len(elements))]
        which, index = np.nonzero(np.stack([look.bad for look in looks]))
        if not len(index):
            return []
        deviations = np.stack([look.deviations for look in looks])[which, index]
        sources, images = points[index], elements.apply(points)[which, index]
        labels = clusters(np.concatenate([sources, images]))
        ends = np.stack([labels[: len(sources)], labels[len(sources) :]], axis=1)
        left = np.ones(len(sources), dtype=np.bool_)
        patches: list[Patch] = []
        while left.any() and len(patches) < _MOST_PATCHES:
            best = _most_telling(ends[left], which[left].astype(np.int32), deviations[left])
            here = left & (ends == best).any(1)
            present = bool((ends[here, 0] == best).sum() >= (ends[here, 1] == best).sum())
            places = (sources if present else images)[here & (ends[:, 0 if present else 1] == best)]
            low, high = places.min(0), places.max(0)
            size = float(np.linalg.norm(high - low))
            patches.append(Patch(0.5 * (low + high), size, float(deviations[here].max()), present))
            left &= ~here
        return sorted(patches, key=lambda patch: -patch.deviation)


def _most_telling(ends: IntArray, which: IntArray, deviations: FloatArray) -> int:
    """The place that most operations deviate at, of several the one with the largest deviation.

    ``ends`` ``(n, 2)``: the places of source and image of each deviation, ``which`` ``(n,)``: its operation.
    """
    places, index = np.unique(ends, return_inverse=True)
    index = index.reshape(-1, 2)
    operations = np.zeros((len(places), int(which.max()) + 1), dtype=np.bool_)
    largest = np.zeros(len(places))
    for side in range(2):
        operations[index[:, side], which] = True
        np.maximum.at(largest, index[:, side], deviations)
    return int(places[np.lexsort((-places, largest, operations.sum(1)))[-1]])


def resolution_of(vertices: FloatArray, drawn_from: FloatArray | None = None) -> float:
    """What the coordinates ``(v, 3)`` of a file may be off by, in their own unit.

    Some values are looked at closely, ``drawn_from`` all vertices as the file has them where these are not.

    Half a step of single precision if all of them are numbers of it; half the diagonal of a cell if they lie on a
    decimal or binary grid that nobody draws on by hand: one that is fine beside the shape, has many values, or is finer
    still and has some.
    """
    largest, extent, single = extent_and_precision(kernel_array(vertices, np.float64))
    result = _SINGLE * largest if single else 2.0**-52 * largest
    drawn_from = vertices if drawn_from is None else drawn_from
    values: FloatArray = np.unique(drawn_from[:: max(1, len(drawn_from) // 5000)].ravel())
    if len(values) <= _SOME_VALUES or extent <= 0.0:
        return result
    fine = (_DRAWN_STEP if len(values) > _MANY_VALUES else _FINE_STEP) * extent
    decimal, binary = np.floor(np.log10(extent)), np.floor(np.log2(extent))
    for step in sorted([*10.0 ** (decimal - np.arange(6)), *2.0 ** (binary - np.arange(20))], reverse=True):
        if _on_grid(values[:: len(values) // _SOME_VALUES], step) and _on_grid(values, step):
            return max(result, 0.5 * 3.0**0.5 * float(step)) if step <= fine else result
    return result


def _on_grid(values: FloatArray, step: float) -> bool:
    cells = values / step
    return bool((np.abs(cells - np.rint(cells)) < 1e-3).all())


def clusters(points: FloatArray) -> IntArray:
    """Labels ``(n,)`` of points ``(n, 3)``: those in the same or adjacent cells of a grid have the same."""
    cells = np.floor(points / _CELL).astype(np.int64)
    cells = np.minimum(cells - cells.min(0), _MOST_CELLS) + 1
    labels = np.empty(len(points), dtype=np.int32)
    grid = np.empty(tuple((cells.max(0) + 2).tolist()), dtype=np.int32)
    connected(cells, grid, labels)
    return labels
