"""Everything this package raises on purpose.

PRSNetError
├── MeshError                    the mesh cannot be used
│   ├── UnsupportedFormatError   no reader for this kind of file
│   ├── UnreadableMeshError      the bytes do not parse as the format they claim
│   ├── EmptyMeshError           it parses, but holds no faces
│   ├── DegenerateMeshError      NaN or infinity, an index out of range, no extent, no area
│   ├── MeshTooLargeError        more vertices or faces than the caller allows
│   ├── TooComplexError          its faces crowd so much that measuring it would take too long
│   ├── NoPlaneError             it has no mirror plane to be completed at
│   └── NoAxisError              it has no rotation axis to be cut into sectors about
└── CheckpointError              the weights file is missing, damaged, or does not fit the network

Messages are sentences a user can act on; they never quote file content.
"""


class PRSNetError(Exception):
    """Base of all errors raised on purpose."""


class MeshError(PRSNetError):
    """The mesh cannot be used."""


class UnsupportedFormatError(MeshError):
    """There is no reader for this kind of file."""


class UnreadableMeshError(MeshError):
    """The bytes do not parse as the format they claim to be."""


class EmptyMeshError(MeshError):
    """The file parses, but holds no faces."""


class DegenerateMeshError(MeshError):
    """NaN or infinite coordinates, an index out of range, no extent or no area."""


class MeshTooLargeError(MeshError):
    """The mesh has more vertices or faces than the caller allows."""


class TooComplexError(MeshError):
    """Faces cross or crowd each other so much that measuring the mesh would take more work than is allowed."""


class NoPlaneError(MeshError):
    """The mesh has no mirror plane within the threshold, and one is needed."""


class NoAxisError(MeshError):
    """The mesh has no rotation axis of the order that is asked for within the threshold, and one is needed."""


class CheckpointError(PRSNetError):
    """The weights file is missing, damaged, or does not fit the network."""
