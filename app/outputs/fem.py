"""Half a part or a sector of it as simulation programs are told: CalculiX's input lines, FreeCAD's Python.

Nothing here knows the mesh of finite elements that is made later on, so names stand for what it has: the element faces
in a cut (``DEPENDENT``, ``INDEPENDENT``), the nodes in one (``SYMMETRY``).
"""

import math
from collections.abc import Sequence

from app.edit_schemas import Half, Sector

_TOLERANCE = 1e-3
"""Share of a part's length along the axis, or of its size, that nodes may lie beside the cut they are tied to."""

_PARALLEL = 1e-9


def sector_with_lines(sector: Sector) -> Sector:
    """The same with ``calculix`` and ``freecad``."""
    first, last = sector.ends
    n, way = sector.order, [b - a for a, b in zip(first, last, strict=True)]
    tolerance = _TOLERANCE * math.hypot(*way) + 2.0 * (sector.max_distance or 0.0)
    calculix = [
        f"** One of {n} sectors. From your mesh, before these lines: *SURFACE, NAME=DEPENDENT with the faces",
        f"** of the elements in the plane {_plane(sector.dependent.normal, sector.dependent.offset)}",
        "** and *SURFACE, NAME=INDEPENDENT with those in",
        f"** the plane {_plane(sector.independent.normal, sector.independent.offset)}",
        f"*TIE, NAME=CYCLIC, CYCLIC SYMMETRY, POSITION TOLERANCE={tolerance:.6g}",
        "DEPENDENT, INDEPENDENT",
        f"*CYCLIC SYMMETRY MODEL, N={n}, NGRAPH={n}, TIE=CYCLIC",
        _numbers([*first, *last]),
    ]
    freecad = [
        "import FreeCAD, ObjectsFem",
        'tie = ObjectsFem.makeConstraintTie(FreeCAD.ActiveDocument, "Cyclic")',
        "tie.CyclicSymmetry = True",
        f"tie.Sectors = {n}",
        f"tie.ConnectedSectors = {n}",
        f"to = FreeCAD.Rotation(FreeCAD.Vector(0, 0, 1), FreeCAD.Vector({_numbers(sector.direction)}))",
        f"tie.SymmetryAxis = FreeCAD.Placement(FreeCAD.Vector({_numbers(first)}), to)",
        f'tie.Tolerance = "{tolerance:.6g} mm"',
        "# tie.References: first the face in the dependent plane, then the one in the independent plane",
    ]
    return sector.model_copy(update={"calculix": _text(calculix), "freecad": _text(freecad)})


def half_with_lines(half: Half) -> Half:
    """The same with ``calculix`` and ``freecad``: nodes in the cut do not leave its plane."""
    normal, (corner, along, _) = half.normal, half.points
    tangent = [b - a for a, b in zip(corner, along, strict=True)]
    length = math.hypot(*tangent)
    tangent = [value / length for value in tangent]
    main = max(range(3), key=lambda axis: abs(normal[axis]))
    straight = math.hypot(*(normal[axis] for axis in range(3) if axis != main)) < _PARALLEL
    degree = main + 1 if straight else 1
    calculix = [
        "** From your mesh, before these lines: *NSET, NSET=SYMMETRY with the nodes",
        f"** in the plane {_plane(normal, half.offset)}",
    ]
    freecad = ["import FreeCAD, ObjectsFem"]
    if not straight:
        calculix += ["*TRANSFORM, NSET=SYMMETRY, TYPE=R", _numbers([*normal, *tangent])]
        freecad += [
            'turn = ObjectsFem.makeConstraintTransform(FreeCAD.ActiveDocument, "Plane")',
            'turn.TransformType = "Rectangular"',
            f"turn.Rotation = FreeCAD.Rotation(FreeCAD.Vector(1, 0, 0), FreeCAD.Vector({_numbers(normal)}))",
        ]
    calculix += ["*BOUNDARY", f"SYMMETRY, {degree}, {degree}"]
    freecad += [
        'fix = ObjectsFem.makeConstraintDisplacement(FreeCAD.ActiveDocument, "Symmetry")',
        f"fix.{'xyz'[degree - 1]}Free = False",
        f"# References{'' if straight else ' of both'}: the face in the plane {_plane(normal, half.offset)}",
    ]
    return half.model_copy(update={"calculix": _text(calculix), "freecad": _text(freecad)})


def _plane(normal: Sequence[float], offset: float) -> str:
    return f"({_numbers(normal)}), offset {offset:.9g}"


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.12g}" for value in values)  # CalculiX reads 20 characters of a number at most


def _text(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"
