"""The viewer's tools in a real browser: several files, levels, drawing, pictures on the mesh, small screens."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.model.meshes.test_looks import laid_box, written

from .server import Server

pytest.importorskip("playwright.sync_api")

from .browser import PHONE
from .visits import EXAMPLES, Visit, expect


def changed(one: Any, other: Any) -> float:
    """Share of the pixels that differ."""
    return float((np.abs(one - other).max(axis=2) > 8).mean())


def test_several_files_are_listed_and_opened_one_by_one(at_home: Visit, tmp_path: Path) -> None:
    (tmp_path / "bad.stl").write_bytes(b"nothing of that kind")
    page = at_home.page
    files = [EXAMPLES / "vase.ply", EXAMPLES / "chair.obj", EXAMPLES / "propeller.stl", tmp_path / "bad.stl"]
    page.locator("#file").set_input_files(files)
    listed = page.get_by_role("region", name="Files")
    expect(listed.get_by_role("heading", name="4 files")).to_be_visible()
    rows = listed.locator(".file")
    expect(rows.nth(0)).to_contain_text("C8v: 8 planes, 1 axis")
    expect(rows.nth(1)).to_contain_text("Cs: 1 plane, 0 axes")
    expect(rows.nth(3)).to_contain_text("The file cannot be read")
    expect(page.get_by_role("heading", name="Point group C8v")).to_be_visible()  # the first is open
    expect(rows.nth(0)).to_have_attribute("aria-current", "true")
    rows.nth(1).click()
    expect(page.locator("#filename")).to_have_text("chair.obj")
    expect(page.get_by_role("heading", name="Point group Cs")).to_be_visible()
    expect(rows.nth(1)).to_have_attribute("aria-current", "true")
    with page.expect_download() as event:
        listed.get_by_role("button", name="CSV of all").click()
    table = list(csv.DictReader(io.StringIO(Path(event.value.path()).read_text(), newline="")))
    kinds = {name: [row["kind"] for row in table if row["file"] == name] for name in (path.name for path in files)}
    assert kinds["vase.ply"] == ["plane"] * 8 + ["axis"]
    assert kinds["chair.obj"] == ["plane"]
    assert kinds["bad.stl"] == ["unreadable-mesh"]
    page.get_by_role("button", name="Open another mesh").click()
    expect(listed).to_be_hidden()
    at_home.choose("Chair")
    expect(listed).to_be_hidden()
    at_home.errors.clear()  # the browser's own words about the file that was refused


def test_the_csv_of_all_is_that_of_the_service(at_home: Visit, server: Server) -> None:
    page = at_home.page
    names = ["nut.glb", "plant.off"]
    page.locator("#file").set_input_files([EXAMPLES / name for name in names])
    with page.expect_download() as event:
        page.get_by_role("button", name="CSV of all").click()
    mine = list(csv.reader(io.StringIO(Path(event.value.path()).read_text(), newline="")))
    theirs: list[list[str]] = []
    for name in names:
        answer = server.detect(name, (EXAMPLES / name).read_bytes(), format="csv")
        theirs += list(csv.reader(io.StringIO(answer.text, newline="")))[bool(theirs) :]
    assert len(mine) == len(theirs)
    for one, other in zip(mine, theirs, strict=True):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert a == b or float(a) == pytest.approx(float(b), rel=1e-9, abs=1e-12)


def test_another_level_can_be_chosen_and_left_again(at_home: Visit, tmp_path: Path) -> None:
    corners = trimesh.creation.box((60, 60, 8)).vertices
    cut = [[x, y, z] for z in (-4, 4) for x, y in ((28, 30), (30, 28))]  # one edge of a square plate is chamfered
    kept = corners[(corners[:, :2] < 29).any(axis=1)]
    trimesh.convex.convex_hull(np.concatenate([kept, cut])).export(tmp_path / "plate.stl")
    at_home.open(tmp_path / "plate.stl")
    page = at_home.page
    ladder = page.get_by_role("region", name="Levels")
    chosen = ladder.locator('.level[aria-pressed="true"] .name')
    first = chosen.inner_text()
    expect(page.get_by_role("heading", name=f"Point group {first}")).to_be_visible()
    others = ladder.locator('.level[aria-pressed="false"]')
    assert others.count() >= 1
    name = others.first.locator(".name").inner_text()
    others.first.click()
    expect(page.get_by_role("heading", name=f"Point group {name}")).to_be_visible()
    assert ("level=exact" in at_home.detections()[-1]) or ("tolerance=" in at_home.detections()[-1])
    expect(chosen).to_have_text(name)
    ladder.get_by_role("button", name="choose for me").click()
    expect(page.get_by_role("heading", name=f"Point group {first}")).to_be_visible()
    expect(ladder.get_by_role("button", name="choose for me")).to_have_count(0)


def test_orthographic_pictures_keep_parallels(at_home: Visit, tmp_path: Path) -> None:
    """Seen along parallel lines the outline of a box is its own image under a half turn of the picture."""
    trimesh.creation.box((1, 0.6, 3)).export(tmp_path / "bar.stl")
    at_home.open(tmp_path / "bar.stl")
    page = at_home.page
    for button in page.get_by_role("button", name="show / hide all").all():
        button.click()

    def turned_over() -> float:
        page.mouse.move(0, 0)
        image = at_home.pixels()[110:-110]
        outline = np.abs(image - image[:4, :4].mean(axis=(0, 1))).max(axis=2) > 30
        assert 0.02 < outline.mean() < 0.8
        return float((outline != outline[::-1, ::-1]).sum() / outline.sum())

    assert turned_over() > 0.03
    page.get_by_text("Drawing").click()
    page.get_by_label("Orthographic").check()
    page.get_by_text("Drawing").click()
    assert turned_over() < 0.01


def test_wireframe_grid_and_ruler(at_home: Visit) -> None:
    at_home.choose("Damaged table")
    page, canvas = at_home.page, at_home.page.locator("#canvas")
    plain = at_home.pixels()
    page.get_by_text("Drawing").click()
    with_box = at_home.pixels()
    page.get_by_label("Wireframe").check()
    wire = at_home.pixels()
    assert changed(with_box, wire) > 0.01
    page.get_by_label("Wireframe").uncheck()
    page.get_by_label("Grid").check()
    step = float(canvas.get_attribute("data-grid"))
    expect(page.locator("#grid-step")).to_have_text(f"A square of the grid is {step:g} mm wide.")
    assert changed(with_box, at_home.pixels()) > 0.002
    page.get_by_label("Grid").uncheck()
    expect(canvas).to_have_attribute("data-grid", "")
    page.get_by_label("Ruler").check()
    expect(page.locator("#grid-step")).to_have_text("Choose a plane or axis to measure.")
    page.get_by_role("button", name="Axis 1").first.click()
    label = page.locator(".ruler-label")
    expect(label).to_contain_text("mm from the origin")
    point = page.locator(".row.selected dd").last.inner_text()
    x, y, _ = (float(text) for text in point.strip("()").split(","))
    expect(label).to_contain_text(f"{np.hypot(x, y):.2g}"[:4])
    page.keyboard.press("Escape")
    page.mouse.click(20, 300)
    expect(page.locator(".drawn .choices")).to_be_hidden()
    page.get_by_text("Drawing").click()
    page.get_by_label("Ruler").uncheck()
    expect(label).to_be_hidden()
    assert plain.shape == at_home.pixels().shape


def test_a_mesh_with_pictures_is_shown_with_them(at_home: Visit, tmp_path: Path) -> None:
    (tmp_path / "laid.glb").write_bytes(written(laid_box()))  # red above z = 0, blue below on the left, white
    at_home.open(tmp_path / "laid.glb")
    page = at_home.page
    expect(page.locator(".warnings")).to_contain_text("colours or textures")
    for button in page.get_by_role("button", name="show / hide all").all():
        button.click()
    page.get_by_text("y up").click()
    page.mouse.move(0, 0)
    image = at_home.pixels()
    red = (image[..., 0] > 120) & (image[..., 1] < 60) & (image[..., 2] < 60)
    blue = (image[..., 2] > 120) & (image[..., 0] < 60)
    assert red.mean() > 0.02
    assert blue.mean() > 0.002
    page.get_by_text("Mirror preview", exact=True).click()  # the image keeps one colour
    page.mouse.move(0, 0)
    assert changed(image, at_home.pixels()) > 0.01


def test_nothing_sticks_out_on_a_phone(visit: Callable[..., Visit], server: Server) -> None:
    for scheme in ("light", "dark"):
        phone = visit(server.url, **PHONE, color_scheme=scheme)
        page = phone.page
        cards = page.locator(".example")
        expect(cards).to_have_count(8)
        too_wide = page.evaluate(
            """() => [...document.querySelectorAll(".example")].flatMap(card => {
              const box = card.getBoundingClientRect();
              return [...card.querySelectorAll("strong, .small")].filter(text => {
                const range = document.createRange();
                range.selectNodeContents(text);
                return [...range.getClientRects()].some(r => r.right > box.right || r.left < box.left);
              }).map(text => text.textContent);
            })"""
        )
        assert too_wide == []
        page.locator("#file").set_input_files([EXAMPLES / "vase.ply", EXAMPLES / "chair.obj"])
        expect(page.get_by_role("region", name="Files").get_by_role("heading", name="2 files")).to_be_visible()
        page.get_by_text("Drawing").click()
        choices = page.locator(".drawn .choices").bounding_box()
        assert choices["x"] >= 0
        assert choices["x"] + choices["width"] <= 390
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert page.evaluate("document.querySelector('#panel').scrollWidth") <= 390
