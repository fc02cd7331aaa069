"""Groups of shapes: by a column of a manifest, and by whether training knows their source."""

from pathlib import Path

import pytest

from training.evaluation.grouping import groups_of, read_column

MANIFEST = "path,split,source,kind\ntrain/a.ply,train,A,cad\ntest/b.ply,test,A,scan\ntest/c.ply,test,C,cad\n"
RECORDS = [{"name": "test/b.ply", "source": "A"}, {"name": "test/c.ply", "source": "C"}, {"name": "x", "source": "D"}]


@pytest.mark.parametrize(
    ("by", "expected"),
    [
        ("source", ["A", "C", "D"]),
        ("kind", ["scan", "cad", "(not in the manifest)"]),
        ("unseen", ["sources seen", "sources never seen", "(not in the manifest)"]),
    ],
)
def test_groups(tmp_path: Path, by: str, expected: list[str]):
    manifest = tmp_path / "manifest.csv"
    manifest.write_text(MANIFEST)
    groups = groups_of(RECORDS, by, read_column(manifest, by))
    assert [groups[record["name"]] for record in RECORDS] == expected


def test_a_manifest_without_the_column_is_refused(tmp_path: Path):
    manifest = tmp_path / "manifest.csv"
    manifest.write_text("path,kind\na,cad\n")
    with pytest.raises(ValueError, match="split"):
        read_column(manifest, "unseen")
    with pytest.raises(ValueError, match="--manifest"):
        read_column(None, "kind")
