"""Pictures on a surface: carried from a file to what is made of it, never decoded here."""

from dataclasses import dataclass

import numpy as np

from model.types import AnyArray, BoolArray, IntArray

_SIGNATURES = {"image/png": b"\x89PNG\r\n\x1a\n", "image/jpeg": b"\xff\xd8\xff"}
MOST_PICTURES = 256
"""Of one mesh; faces with further ones have none."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG or JPEG file, as it came."""

    content: bytes
    media_type: str


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """Pictures on a surface; the colours of its vertices are multiplied by them, in linear light.

    Attributes:
        places: (v, 2) float32, where vertices are in their picture: 0 to 1 from its upper left corner right and down,
            repeated beyond.
        of_face: (f,) int32, number of the picture on each face, -1 for none.
        pictures: at most `MOST_PICTURES`.
    """

    places: AnyArray
    of_face: IntArray
    pictures: tuple[Picture, ...]

    def part(self, faces: BoolArray | IntArray | None = None, vertices: IntArray | None = None) -> "Texture":
        """That of some of the faces and vertices of a mesh; None for all of them."""
        places = self.places if vertices is None else self.places[vertices]
        return Texture(places, self.of_face if faces is None else self.of_face[faces], self.pictures)


def picture(content: bytes | None) -> Picture | None:
    """A file's content as a picture; None where it is none that every viewer of glTF knows."""
    kinds = [kind for kind, signature in _SIGNATURES.items() if content and content.startswith(signature)]
    return Picture(content, kinds[0]) if content and kinds else None


def texture(places: AnyArray, of_face: IntArray, pictures: list[Picture]) -> Texture | None:
    """A texture without places that are no numbers; None where no face has a picture."""
    if not pictures or not len(of_face) or int(of_face.max()) < 0:
        return None
    with np.errstate(over="ignore"):
        small = places.astype(np.float32)
    return Texture(np.where(np.isfinite(small), small, np.float32(0.0)), of_face.astype(np.int32), tuple(pictures))
