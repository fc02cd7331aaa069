"""Files that are no mesh in a format that is read here: what they are, and what to do with them."""

import re
import zipfile
from io import BytesIO
from pathlib import PurePath

from model.formats import FORMATS

_TESSELLATE = "Open it in a CAD program, such as FreeCAD, and export a mesh as STL or 3MF."
_EXPORT = "Open it in Blender, or in the program that made it, and export it as GLB."
_UNPACK = "Unpack it and send the mesh that is inside."
_POINTS = "It holds points; save them as PLY, PCD or LAS, with CloudCompare for example."
_NO_GEOMETRY = "It holds materials, pictures or text; send the file with the mesh."

_NEXT_STEPS: dict[str, str] = {
    **dict.fromkeys(
        ("step", "stp", "iges", "igs", "brep", "x_t", "x_b", "sat", "sldprt", "sldasm", "ipt", "iam", "prt", "catpart",
         "catproduct", "jt", "ifc", "dwg", "dxf", "3dm", "scad", "fcstd", "f3d"),
        _TESSELLATE,
    ),
    **dict.fromkeys(
        ("fbx", "blend", "dae", "usd", "usda", "usdc", "usdz", "3ds", "max", "ma", "mb", "c4d", "skp", "x3d", "wrl",
         "vrml", "abc", "lwo", "x", "amf", "vrm", "b3dm", "ctm", "msh", "vtk", "vtp", "vtu"),
        _EXPORT,
    ),
    **dict.fromkeys(("gz", "tgz", "bz2", "xz", "7z", "rar", "tar", "zst"), _UNPACK),
    **dict.fromkeys(("laz", "e57", "ptx", "copc"), _POINTS),
    **dict.fromkeys(("mtl", "png", "jpg", "jpeg", "bmp", "tga", "txt", "pdf", "html", "json"), _NO_GEOMETRY),
    "bin": "It holds the numbers of a .gltf file; send that file, with this one beside it.",
}  # fmt: skip

_HTML = (b"<!doctype html", b"<html", b"<head", b"<body")
_MESSAGE = "perhaps a message of the server that it came from. Open it in a text editor, and get the mesh anew."
_IGES = re.compile(rb"[^\r\n]{72}S[ 0]*1\r?\n")
_SIGNATURES: tuple[tuple[bytes, str], ...] = (
    (b"version https://git-lfs.github.com/spec", "a pointer of Git LFS, not the mesh itself. "
     'Run "git lfs pull" in the repository, and send the file then.'),
    (b"ISO-10303-21", f"a STEP file. {_TESSELLATE}"),
    (b"Kaydara FBX Binary", f"an FBX file. {_EXPORT}"),
    (b"; FBX", f"an FBX file. {_EXPORT}"),
    (b"BLENDER", f"a Blender file. {_EXPORT}"),
    (b"#usda", f"a USD file. {_EXPORT}"),
    (b"PXR-USDC", f"a USD file. {_EXPORT}"),
    (b"#VRML", f"a VRML file. {_EXPORT}"),
    (b"\xd0\xcf\x11\xe0", f"a document of a CAD or drawing program. {_TESSELLATE}"),
    (b"\x1f\x8b", f"packed with gzip. {_UNPACK}"),
    (b"BZh", f"packed with bzip2. {_UNPACK}"),
    (b"\xfd7zXZ", f"packed with xz. {_UNPACK}"),
    (b"7z\xbc\xaf\x27\x1c", f"a 7z archive. {_UNPACK}"),
    (b"Rar!", f"a RAR archive. {_UNPACK}"),
    (b"\x28\xb5\x2f\xfd", f"packed with Zstandard. {_UNPACK}"),
    (b"%PDF", "a PDF document. Send the mesh itself."),
    (b"\x89PNG", "a picture. Send the mesh itself."),
    (b"\xff\xd8\xff", "a picture. Send the mesh itself."),
    (b"DRACO", "bare Draco data. Decode it with draco_decoder to OBJ or PLY, or put it into a GLB."),
)  # fmt: skip


def next_step(extension: str) -> str:
    """A sentence, with a blank before it, on what to do with a file of that extension; empty if none is known."""
    step = _NEXT_STEPS.get(extension)
    return f" {step}" if step else ""


def foreign_content(data: bytes) -> str:
    """What the bytes are if they are surely no mesh of a format that is read here, and the next step; or nothing."""
    head = data[:1024]
    for signature, words in _SIGNATURES:
        if head.startswith(signature):
            return words
    if _IGES.match(head):
        return f"an IGES file. {_TESSELLATE}"
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if text.startswith(_HTML) or (text.startswith((b"<!--", b"<?xml", b"<!doctype")) and b"<html" in text):
        return "a web page. Open its address in a browser, download the mesh from there, and send that file."
    if text.startswith((b"<?xml", b"<collada", b"<x3d", b"<amf", b"<!--", b"<error", b"<svg")):
        return _markup(text)
    if text.startswith((b"{", b"[")) and b'"asset"' not in data:
        return f"JSON and no glTF, {_MESSAGE}"
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return _archive(data)
    return ""


def _markup(text: bytes) -> str:
    """What kind of XML a text in lower case begins with."""
    if b"<collada" in text:
        return f"a Collada (DAE) file. {_EXPORT}"
    if b"<x3d" in text or b"<amf" in text:
        return f"an X3D or AMF file. {_EXPORT}"
    if b"<svg" in text:
        return "a picture. Send the mesh itself."
    return f"an XML file, {_MESSAGE}"


def _archive(data: bytes) -> str:
    """What kind of zip archive it is; names inside are counted, never told."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            kinds = [
                PurePath(name).suffix[1:].lower() for name in archive.namelist() if not name.startswith("__MACOSX/")
            ]
    except (zipfile.BadZipFile, ValueError, EOFError, NotImplementedError, OSError):
        return ""
    if any(kind in ("usd", "usda", "usdc") for kind in kinds):
        return f"a USDZ file. {_EXPORT}"
    if "model" in kinds or all(kind == "npy" for kind in kinds):
        return ""
    meshes = [kind for kind in kinds if kind in FORMATS]
    if len(meshes) == 1:
        label = FORMATS[meshes[0]].label
        return f"a zip archive that holds one mesh, in {label}. Name it .zip, or unpack it and send that."
    if meshes:
        return f"a zip archive that holds {len(meshes)} meshes. Unpack it and send one of them."
    return "a zip archive without a mesh in it. Send the mesh itself."
