"""3MF files of slicers: what steers the printing is no part of the shape, and what is left out is told."""

import pytest

from model.errors import UnsupportedFormatError
from model.formats import read_mesh
from tests.model.mesh_files import XML_TETRAHEDRON, archive, three_mf

BOTH = (
    "<vertices>" + "".join(
        f"<vertex x='{x + 20 * body}' y='{y}' z='{z}'/>"
        for body in (0, 1) for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    ) + "</vertices><triangles>" + "".join(
        f"<triangle v1='{a + 4 * body}' v2='{b + 4 * body}' v3='{c + 4 * body}'/>"
        for body in (0, 1) for a, b, c in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    ) + "</triangles>"
)  # fmt: skip
MESH = f"<object id='1' type='model'><mesh>{BOTH}</mesh></object>"
BUILD = "<item objectid='1'/>"


def prusa(key, value):
    config = (
        "<?xml version='1.0'?><config><object id='1'><metadata type='object' key='name' value='a'/>"
        "<volume firstid='0' lastid='3'><metadata type='volume' key='volume_type' value='ModelPart'/></volume>"
        f"<volume firstid='4' lastid='7'><metadata type='volume' key='{key}' value='{value}'/></volume>"
        "</object></config>"
    )
    return read_mesh(three_mf(MESH, BUILD, **{"Metadata/Slic3r_PE_model.config": config}), "a.3mf")


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("volume_type", "ParameterModifier", "steer"),
        ("volume_type", "SupportBlocker", "steer"),
        ("volume_type", "SupportEnforcer", "steer"),
        ("volume_type", "NegativeVolume", "not subtracted"),
        ("modifier", "1", "steer"),
    ],
)
def test_volumes_of_prusaslicer_that_are_no_shape(key, value, words):
    read = prusa(key, value)
    assert len(read.faces) == len(read.vertices) == 4
    assert read.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]
    (warning,) = read.warnings
    assert words in warning


def test_volumes_of_prusaslicer_that_are():
    for key, value in (("volume_type", "ModelPart"), ("modifier", "0"), ("extruder", "2")):
        read = prusa(key, value)
        assert (len(read.faces), read.warnings) == (8, ())


@pytest.mark.parametrize(
    ("subtype", "faces", "words"),
    [
        ("normal_part", 12, None),
        ("modifier_part", 8, "2 volumes made only to steer"),
        ("support_blocker", 8, "steer"),
        ("support_enforcer", 8, "steer"),
        ("negative_part", 8, "not subtracted"),
    ],
)
def test_parts_of_bambu_studio(subtype, faces, words):
    core = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    objects = "".join(f"<object id='{n}'><mesh>{XML_TETRAHEDRON}</mesh></object>" for n in (1, 2))
    part = f"<model xmlns='{core}'><resources>{objects}</resources></model>"
    components = "".join(f"<component p:path='/3D/Objects/o.model' objectid='{n}'/>" for n in (1, 2))
    config = (
        "<config><object id='8'><metadata key='name' value='x'/><part id='1' subtype='normal_part'/>"
        f"<part id='2' subtype='{subtype}'><metadata key='matrix' value='1'/></part></object>"
        f"<object id='9'><part id='1' subtype='normal_part'/><part id='2' subtype='{subtype}'/></object></config>"
    )
    objects = f"<object id='8'><components>{components}</components></object>"
    objects += "<object id='9'><components><component p:path='/3D/Objects/o.model' objectid='1'/></components></object>"
    objects += f"<object id='7'><components>{components}</components></object>"
    more = {"3D/Objects/o.model": part, "Metadata/model_settings.config": config}
    build = "<item objectid='8'/><item objectid='9'/>" + ("<item objectid='8'/>" if faces == 8 else "")
    read = read_mesh(three_mf(objects, build, **more), "a.3mf")
    assert len(read.faces) == faces + 4 * (faces == 8)
    assert (words is None) == (not read.warnings)
    assert words is None or words.replace("2 volumes", "2 volumes") in read.warnings[0]


@pytest.mark.parametrize("name", ["support_mesh", "anti_overhang_mesh", "infill_mesh", "cutting_mesh"])
@pytest.mark.parametrize("older", [False, True])
def test_helpers_of_cura(name, older):
    space = "http://software.ultimaker.com/xml/cura/3mf/2015/10"
    for value, faces in (("True", 4), ("False", 8)):
        settings = (
            f"<cura:settings xmlns:cura='{space}'><cura:setting cura:key='{name}'>{value}</cura:setting>"
            "</cura:settings>"
            if older
            else f"<metadatagroup><metadata name='cura:{name}'>{value}</metadata></metadatagroup>"
        )
        objects = f"<object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object>"
        objects += f"<object id='2'>{settings}<mesh>{XML_TETRAHEDRON}</mesh></object>"
        read = read_mesh(three_mf(objects, "<item objectid='1'/><item objectid='2'/>"), "a.3mf")
        assert len(read.faces) == faces
        assert bool(read.warnings) == (faces == 4)


def test_objects_of_type_other_are_left_out_and_told():
    objects = f"<object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object>"
    objects += f"<object id='2' type='other'><mesh>{XML_TETRAHEDRON}</mesh></object>"
    read = read_mesh(three_mf(objects, "<item objectid='1'/><item objectid='2'/>"), "a.3mf")
    assert len(read.faces) == 4
    assert read.warnings


def test_required_extensions():
    def file(space):
        core = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
        objects = f"<resources><object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object></resources>"
        return archive(
            f"<model xmlns='{core}' xmlns:e='{space}' requiredextensions='e'>{objects}<build>{BUILD}</build></model>"
        )

    assert read_mesh(file("http://schemas.microsoft.com/3dmanufacturing/production/2015/06"), "a.3mf").watertight
    for name in ("booleanoperations/2023/07", "securecontent/2019/04"):
        with pytest.raises(UnsupportedFormatError, match="requires an extension"):
            read_mesh(file(f"http://schemas.3mf.io/3dmanufacturing/{name}"), "a.3mf")


@pytest.mark.parametrize("attribute", ["paint_color='8'", "s:mmu_segmentation='4'"])
def test_colours_painted_in_a_slicer_are_told(attribute):
    """What is painted with a brush in Bambu Studio, OrcaSlicer and PrusaSlicer is not read, and not lost unsaid."""
    mesh = XML_TETRAHEDRON.replace(
        "<triangle ", f"<triangle xmlns:s='http://schemas.slic3r.org/3mf/2017/06' {attribute} ", 1
    )
    data = three_mf(f"<object id='1'><mesh>{mesh}</mesh></object>", "<item objectid='1'/>")
    assert read_mesh(data, "a.3mf").painted
    assert any("painted on the surface in a slicer" in text for text in read_mesh(data, "a.3mf", looks=True).warnings)
    plain = three_mf(f"<object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object>", "<item objectid='1'/>")
    assert not read_mesh(plain, "a.3mf").painted
    assert not read_mesh(plain, "a.3mf", looks=True).warnings
