"""Pictures on a surface: carried from a file to what is made of it, never decoded here."""

import re
from dataclasses import dataclass

import numpy as np

from model.types import AnyArray, BoolArray, IntArray

_SIGNATURES = {
    "image/png": re.compile(rb"\x89PNG\r\n\x1a\n"),
    "image/jpeg": re.compile(rb"\xff\xd8\xff"),
    "image/webp": re.compile(rb"RIFF.{4}WEBP", re.DOTALL),
    "image/ktx2": re.compile(rb"\xabKTX 20\xbb\r\n\x1a\n"),
}
SIGNATURE_BYTES = 12
"""How much of a file says which kind of picture it is."""

MOST_PICTURES = 256
"""Of one mesh; faces with further ones have none."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A file of PNG, JPEG, WebP or KTX2 (with Basis Universal), as it came."""

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
    """A file's content as a picture; None where it is none that glTF has a place for."""
    kinds = [kind for kind, signature in _SIGNATURES.items() if content and signature.match(content)]
    return Picture(content, kinds[0]) if content and kinds else None


def lost_pictures(count: int) -> tuple[str, ...]:
    """What to tell about pictures that a file names and that could not be read."""
    if count == 0:
        return ()
    which, they = ("A picture", "it is") if count == 1 else (f"{count} pictures", "they are")
    return (f"{which} of the surface left out: {they} not beside the file, or neither PNG, JPEG, WebP nor KTX2.",)


def texture(places: AnyArray, of_face: IntArray, pictures: list[Picture]) -> Texture | None:
    """A texture without places that are no numbers; None where no face has a picture."""
    if not pictures or not len(of_face) or int(of_face.max()) < 0:
        return None
    with np.errstate(over="ignore"):
        small = places.astype(np.float32)
    return Texture(np.where(np.isfinite(small), small, np.float32(0.0)), of_face.astype(np.int32), tuple(pictures))
