"""PRS-Net as a library: the network, exact geometry on meshes, validation, and the detector over them.

Names are loaded on first use: `training fit` needs the network alone, on machines that have torch and numpy
but neither a mesh library nor a compiler for the kernels.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from model.detection import Axis, Detection, Plane, Rejected
    from model.detector import Detector
    from model.errors import CheckpointError, MeshError, PRSNetError
    from model.formats import read_mesh
    from model.meshes.mesh import Mesh
    from model.network.network import PRSNet

__version__ = "0.1.0"

_HOMES = {
    "Axis": "detection",
    "CheckpointError": "errors",
    "Detection": "detection",
    "Detector": "detector",
    "Mesh": "meshes.mesh",
    "MeshError": "errors",
    "PRSNet": "network.network",
    "PRSNetError": "errors",
    "Plane": "detection",
    "Rejected": "detection",
    "read_mesh": "formats",
}

__all__ = [
    "Axis",
    "CheckpointError",
    "Detection",
    "Detector",
    "Mesh",
    "MeshError",
    "PRSNet",
    "PRSNetError",
    "Plane",
    "Rejected",
    "read_mesh",
]


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'model' has no attribute {name!r}")
    return getattr(import_module(f"model.{_HOMES[name]}"), name)
