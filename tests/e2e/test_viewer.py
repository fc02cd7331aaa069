"""The viewer in a real browser against a real service: everything a person can do there."""

import json
import shlex
import subprocess
import time
from collections.abc import Callable
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh
from PIL import Image

from app import problems

from .server import Server, running

pytest.importorskip("playwright.sync_api")

from .browser import PHONE
from .visits import DEFAULT, EXAMPLES, Visit, expect, sync_api

Browser, Page, Request, Route = sync_api.Browser, sync_api.Page, sync_api.Request, sync_api.Route


def numbers_of(visit: Visit) -> list[str]:
    return visit.page.locator(".results:not(.rejected) .numbers > span:first-child").all_inner_texts()


def test_an_example_from_choice_to_result(at_home: Visit, server: Server) -> None:
    at_home.choose("Vase")
    page = at_home.page
    expect(page.get_by_role("heading", name="Point group C8v")).to_be_visible()
    expect(page.get_by_text("One 8-fold axis (turns by 45°) and eight mirror planes")).to_be_visible()
    expect(page.get_by_role("status")).to_have_text("Done: point group C8v, 8 planes, 1 axis.")
    at_home.expect_shown(*(f"plane {k}" for k in range(8)), "axis 0")
    answer = server.detect("vase.ply", (EXAMPLES / "vase.ply").read_bytes()).json()
    told = [float(number) for number in numbers_of(at_home)]
    assert told == pytest.approx([entry["symmetry_error"] for entry in answer["planes"] + answer["axes"]], rel=0.06)
    expect(page.locator(".row", has_text="8-fold")).to_have_count(1)
    assert page.title().startswith("vase.ply: C8v")


def test_every_format_is_shown(at_home: Visit, server: Server, data: Path) -> None:
    for name in ("chair.obj", "table.glb", "stool.3mf", "vase.ply", "barrel.stl", "donut.gltf", "plant.off"):
        at_home.open(data / name)
        answer = server.detect(name, (data / name).read_bytes()).json()
        expect(at_home.page.locator("#canvas")).to_have_attribute("data-faces", str(answer["mesh"]["faces"]))
        assert len(at_home.shown()) == len(answer["planes"]) + len(answer["axes"])
    assert len(np.unique(at_home.pixels().reshape(-1, 3), axis=0)) > 100  # a shaded thing on a ground


def drop(page: Any, path: Path) -> None:
    """What a browser does when a file is dragged from the desktop and let go over the page."""
    transfer = page.evaluate_handle(
        """([name, bytes]) => {
          const transfer = new DataTransfer();
          transfer.items.add(new File([new Uint8Array(bytes)], name));
          return transfer;
        }""",
        [path.name, list(path.read_bytes())],
    )
    page.dispatch_event("#picture", "dragenter", {"dataTransfer": transfer})
    expect(page.get_by_text("Drop the mesh anywhere")).to_be_visible()
    page.dispatch_event("#picture", "drop", {"dataTransfer": transfer})
    expect(page.get_by_text("Drop the mesh anywhere")).to_be_hidden()


def test_files_are_dropped_one_after_the_other(at_home: Visit, data: Path) -> None:
    drop(at_home.page, data / "chair.obj")
    expect(at_home.page.get_by_role("heading", name="Point group Cs")).to_be_visible()
    drop(at_home.page, data / "table.glb")
    expect(at_home.page.get_by_role("heading", name="Point group C2v")).to_be_visible()
    at_home.page.get_by_role("button", name="Open another mesh").click()
    expect(at_home.page.get_by_role("button", name="Drop meshes here")).to_be_visible()
    expect(at_home.page.locator("#panel")).to_be_hidden()


def test_results_are_switched_off_and_on(at_home: Visit) -> None:
    at_home.choose("Damaged table")
    at_home.expect_shown("plane 0", "plane 1", "axis 0")
    full = at_home.pixels()
    at_home.page.get_by_role("button", name="Show Plane 1").click()
    at_home.page.mouse.move(0, 0)
    at_home.expect_shown("plane 1", "axis 0")
    expect(at_home.page.get_by_role("button", name="Show Plane 1")).to_have_attribute("aria-pressed", "false")
    assert (np.abs(at_home.pixels() - full).max(axis=2) > 8).mean() > 0.005
    at_home.page.get_by_role("button", name="show / hide all").first.click()
    at_home.expect_shown("axis 0")
    at_home.page.get_by_role("button", name="show / hide all").first.click()
    at_home.expect_shown("plane 0", "plane 1", "axis 0")
    assert (np.abs(at_home.pixels() - full).max(axis=2) > 8).mean() < 0.002


def test_list_and_picture_answer_to_each_other(at_home: Visit) -> None:
    at_home.choose("Chair")
    row = at_home.page.locator(".row").first
    plain = at_home.pixels()
    row.hover()
    assert (np.abs(at_home.pixels() - plain).max(axis=2) > 8).mean() > 0.005  # drawn more strongly
    box = at_home.page.locator("#canvas").bounding_box()
    at_home.page.mouse.move(box["x"] + 10, box["y"] + box["height"] / 2)
    assert "hovered" not in row.get_attribute("class")
    at_home.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert "hovered" in row.get_attribute("class")
    at_home.page.mouse.down()
    at_home.page.mouse.up()
    expect(row.locator(".pick")).to_have_attribute("aria-pressed", "true")
    expect(row.get_by_text("(1, 0, 0)")).to_be_visible()
    row.locator(".pick").click()
    expect(row.locator("dl")).to_have_count(0)


def test_the_mouse_turns_the_picture_and_0_resets_it(at_home: Visit) -> None:
    at_home.choose("Chair")
    first = at_home.pixels()
    box = at_home.page.locator("#canvas").bounding_box()
    at_home.page.mouse.move(box["x"] + 100, box["y"] + 300)
    at_home.page.mouse.down()
    at_home.page.mouse.move(box["x"] + 300, box["y"] + 300, steps=4)
    at_home.page.mouse.up()
    at_home.page.mouse.move(0, 0)
    assert (np.abs(at_home.pixels() - first).max(axis=2) > 8).mean() > 0.02
    at_home.page.locator("#canvas").press("0")
    at_home.page.locator("#canvas").blur()
    assert (np.abs(at_home.pixels() - first).max(axis=2) > 8).mean() < 0.002
    at_home.page.get_by_text("z up").click()
    at_home.page.mouse.move(0, 0)
    assert (np.abs(at_home.pixels() - first).max(axis=2) > 8).mean() > 0.02


def test_paper_mode(at_home: Visit, server: Server) -> None:
    at_home.choose("Vase")
    at_home.page.get_by_text("Paper", exact=True).click()
    answer = server.detect("vase.ply", (EXAMPLES / "vase.ply").read_bytes(), mode="paper").json()
    expect(at_home.page.locator(".results:not(.rejected) .row")).to_have_count(
        len(answer["planes"]) + len(answer["axes"])
    )
    assert len(answer["planes"]) <= 3
    assert "mode=paper" in at_home.detections()[-1]
    assert at_home.page.get_by_label("Paper").is_checked()
    at_home.page.get_by_text("Full", exact=True).click()
    expect(at_home.page.locator(".results:not(.rejected) .row")).to_have_count(9)


def test_levels_say_where_the_chosen_one_does_not_hold(at_home: Visit) -> None:
    at_home.choose("Damaged table")
    levels = at_home.page.get_by_role("region", name="Levels")
    chosen = levels.locator('.level[aria-pressed="true"]')
    expect(chosen.locator(".name")).to_have_text(["C2v"])
    expect(chosen.locator(".note")).to_contain_text("chosen")
    breaks = levels.locator("ul.small li")
    expect(breaks).to_have_count(1)
    expect(breaks).to_contain_text("missing at (0.5")  # the corner
    at_home.page.get_by_text("Paper", exact=True).click()
    expect(levels).to_have_count(0)


def test_similar_elements_are_listed_apart_and_can_be_looked_at(at_home: Visit) -> None:
    at_home.choose("Propeller")
    expect(at_home.page.get_by_role("heading", name="Point group C5")).to_be_visible()
    at_home.page.locator("summary", has_text="Similar").click()
    at_home.page.locator(".rejected .pick", has_text="belongs to no group").first.click()
    at_home.page.mouse.move(0, 0)
    assert "similar 0" in at_home.shown()


def test_the_largest_error_is_chosen_on_a_logarithmic_scale(at_home: Visit) -> None:
    at_home.choose("Plant")
    slider = at_home.page.get_by_label("Largest error")
    expect(at_home.page.locator("#max-error-value")).to_have_text("4e-4")
    assert slider.get_attribute("aria-valuetext") == "4e-4, an rms deviation of 2 % of the diameter"
    expect(at_home.page.get_by_role("heading", name="Point group C1")).to_be_visible()
    expect(at_home.page.get_by_text("No planes within the largest error.")).to_be_visible()
    at_home.expect_shown()
    expect(at_home.page.locator("#views")).to_be_hidden()
    slider.press("End")
    expect(at_home.page.get_by_role("heading", name="Point group Cs")).to_be_visible()
    assert "max_error=0.1" in at_home.detections()[-1]
    at_home.expect_shown("plane 0")
    slider.press("Home")
    expect(at_home.page.get_by_role("heading", name="Point group C1")).to_be_visible()
    assert "max_error=0.000001" in at_home.detections()[-1]
    at_home.page.get_by_role("button", name="reset", exact=True).click()
    expect(at_home.page.locator("#max-error-value")).to_have_text("4e-4")


def test_rejected_candidates_say_why_and_can_be_looked_at(at_home: Visit) -> None:
    at_home.choose("Plant")
    expect(at_home.page.get_by_role("heading", name="Point group C1")).to_be_visible()
    at_home.expect_shown()
    at_home.page.get_by_text("Rejected candidates").click()
    candidate = at_home.page.locator(".rejected .pick", has_text="its error is over the largest allowed").first
    candidate.click()
    at_home.page.mouse.move(0, 0)
    assert len(at_home.shown()) == 1
    assert at_home.shown()[0].startswith("rejected")
    at_home.page.get_by_text("Mirror preview", exact=True).click()
    expect(at_home.page.locator("#legend")).to_contain_text("the chosen candidate")


def test_mirror_preview_has_two_colours(at_home: Visit) -> None:
    at_home.choose("Chair")
    at_home.page.get_by_text("Mirror preview", exact=True).click()
    expect(at_home.page.locator("#legend")).to_contain_text("its mirror image")
    red, green, blue = np.moveaxis(at_home.pixels(), 2, 0)
    blueish, orange = (blue - red > 40) & (green > red), (red - blue > 40) & (green > blue)
    assert blueish.mean() > 0.01
    assert orange.mean() > 0.01
    # The image stands on the other side: half of the picture is left of it.
    assert abs(np.nonzero(blueish)[1].mean() - np.nonzero(orange)[1].mean()) > 30


def test_heat_map(at_home: Visit) -> None:
    at_home.choose("Damaged table")
    at_home.page.get_by_text("Heat map", exact=True).click()
    expect(at_home.page.locator("#legend")).to_contain_text("largest 0.")

    def strong() -> float:
        red, green, blue = np.moveaxis(at_home.pixels()[60:-120, 60:-60], 2, 0)  # without legend and arrows
        return float(((red - green > 100) & (red > blue)).mean())

    at_home.page.get_by_role("button", name="Plane 2").first.click()  # the hole is seen from its other side
    end = time.monotonic() + 30
    while strong() < 3e-4:  # where the other side has nothing
        assert time.monotonic() < end
        at_home.page.wait_for_timeout(50)
    at_home.page.get_by_role("button", name="Open another mesh").click()
    at_home.choose("Chair")
    at_home.page.get_by_text("Heat map", exact=True).click()
    expect(at_home.page.locator("#legend")).to_contain_text("e-")
    assert strong() == 0.0


BAD_FILES = [
    ("notes.docx", b"PK\x03\x04 text", "This format is not read"),
    ("empty.stl", b"", "The file cannot be read"),
    ("short.glb", b"glTF\x02\0\0\0\xff\0\0\0", "The file cannot be read"),
    ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "There is no surface in the file"),
    ("nan.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "The mesh cannot be measured"),
]


def test_bad_files(at_home: Visit, tmp_path: Path) -> None:
    at_home.choose("Chair")
    for name, content, title in BAD_FILES:
        (tmp_path / name).write_bytes(content)
        at_home.page.locator("#file").set_input_files(tmp_path / name)
        expect(at_home.problem().get_by_role("heading", name=title)).to_be_visible()
        expect(at_home.problem().get_by_text("Request id")).to_be_visible()
        at_home.problem().get_by_role("button", name="Close").click()
        expect(at_home.problem()).to_be_hidden()
        expect(at_home.page.locator("#filename")).to_have_text("chair.obj")  # what was there stays
    at_home.page.get_by_text("Paper", exact=True).click()
    expect(at_home.page.get_by_role("heading", name="Point group Cs")).to_be_visible()
    at_home.errors[:] = [error for error in at_home.errors if "the server responded with a status of 4" not in error]


def _fulfil(status: int, body: str, route: Any) -> None:
    route.fulfill(status=status, body=body)


def test_problems_of_the_service(at_home: Visit) -> None:
    """Those that a file cannot provoke; tests/app/test_pages.py says that there are words for all."""
    for kind in (problems.OVERLOADED, problems.DEADLINE, problems.INTERNAL, problems.MESH_TOO_LARGE):
        body = json.dumps(problems.body(kind, kind.example, "0123456789abcdef"))
        at_home.page.route("**/detect*", partial(_fulfil, kind.status, body), times=1)
        at_home.page.get_by_role("button", name="Chair").click()
        expect(at_home.problem()).to_contain_text(kind.example)
        expect(at_home.problem()).to_contain_text("0123456789abcdef")
        again = at_home.problem().get_by_role("button", name="Try again").count() == 1
        assert again == (kind in (problems.OVERLOADED, problems.DEADLINE))
        at_home.problem().get_by_role("button", name="Close").click()
        expect(at_home.problem()).to_be_hidden()
    at_home.errors.clear()


def test_no_answer_and_try_again(at_home: Visit) -> None:
    at_home.page.route("**/detect*", lambda route: route.abort())
    at_home.page.get_by_role("button", name="Chair").click()
    expect(at_home.problem()).to_contain_text("The service does not answer")
    at_home.page.unroute("**/detect*")
    at_home.problem().get_by_role("button", name="Try again").click()
    expect(at_home.page.get_by_role("heading", name="Point group Cs")).to_be_visible()
    at_home.errors.clear()


def test_a_service_that_is_starting_is_waited_for(at_home: Visit) -> None:
    body = json.dumps(problems.body(problems.NOT_READY, problems.NOT_READY.example, "0"))
    at_home.page.route("**/detect*", lambda route: route.fulfill(status=503, body=body), times=1)
    at_home.page.get_by_role("button", name="Chair").click()
    expect(at_home.page.get_by_text("The service is starting")).to_be_visible()
    expect(at_home.page.get_by_role("heading", name="Point group Cs")).to_be_visible()
    at_home.errors.clear()


def test_cancel(at_home: Visit) -> None:
    at_home.page.route("**/detect*", lambda _: None)  # never answered
    at_home.page.get_by_role("button", name="Chair").click()
    expect(at_home.page.locator("#progress")).to_contain_text("chair.obj")
    at_home.page.get_by_role("button", name="Cancel").click()
    expect(at_home.page.locator("#progress")).to_be_hidden()
    expect(at_home.page.get_by_role("status")).to_have_text("Cancelled.")
    at_home.page.unroute("**/detect*")
    at_home.choose("Chair")


def test_a_key_is_asked_for_and_limits_are_told_before_anything_is_sent(
    visit: Callable[..., Visit], tmp_path: Path
) -> None:
    limits = {"API_KEYS": "open-sesame", "MAX_UPLOAD_BYTES": "8192", "WORKERS": "1"}
    with running(tmp_path / "log", **limits) as server:
        locked = visit(server.url)
        dialog = locked.page.get_by_role("dialog", name="This service needs a key")
        expect(dialog).to_be_visible()
        dialog.get_by_role("button", name="Cancel").click()
        locked.page.get_by_role("button", name="Chair").click()
        dialog.get_by_label("Key").fill("wrong")
        dialog.get_by_role("button", name="Use this key").click()
        expect(dialog.get_by_label("Key")).to_have_value("")  # asked again
        dialog.get_by_label("Key").fill("open-sesame")
        dialog.get_by_label("Key").press("Enter")
        expect(locked.page.get_by_role("heading", name="Point group Cs")).to_be_visible()
        locked.page.reload()  # the key is kept, and so the limits are known
        locked.page.wait_for_load_state("networkidle")
        before = len(locked.detections())
        (tmp_path / "large.stl").write_bytes(b"\0" * 9000)
        locked.page.locator("#file").set_input_files(tmp_path / "large.stl")
        expect(locked.problem()).to_contain_text("The file has 9 kB; the service takes 8 kB.")
        assert len(locked.detections()) == before
        locked.errors[:] = [error for error in locked.errors if "status of 401" not in error]
        assert locked.errors == []


def test_downloads(at_home: Visit, data: Path) -> None:
    at_home.open(data / "table.glb")
    page = at_home.page
    with page.expect_download() as event:
        page.get_by_role("button", name="Annotated GLB").click()
    assert event.value.suggested_filename == "table-symmetries.glb"
    scene = trimesh.load_scene(BytesIO(Path(event.value.path()).read_bytes()), file_type="glb")
    assert {"mesh", "plane 0", "plane 1", "axis 0"} <= set(scene.graph.nodes)


def test_completion(at_home: Visit, server: Server) -> None:
    at_home.choose("Damaged table")
    page = at_home.page
    expect(page.get_by_text("at the best plane.")).to_be_visible()
    page.get_by_role("button", name="Plane 2").first.click()
    expect(page.get_by_text("at plane 2.")).to_be_visible()
    page.get_by_label("Format of the completed mesh").select_option("obj")
    with page.expect_download() as event:
        page.get_by_role("button", name="Completed mesh").click()
    assert event.value.suggested_filename == "broken-completed.obj"
    completed = trimesh.load_mesh(BytesIO(Path(event.value.path()).read_bytes()), file_type="obj")
    broken = httpx.post(f"{server.url}/detect", files={"file": ("broken.3mf", (EXAMPLES / "broken.3mf").read_bytes())})
    assert len(completed.faces) > broken.json()["mesh"]["faces"]
    expect(page.locator(".outcome")).to_contain_text("faces added")
    plane = broken.json()["planes"][1]
    asked = httpx.URL(next(address for address in at_home.asked if "/complete" in address)).params
    assert [float(x) for x in asked["normal"].split(",")] == plane["normal"]
    assert float(asked["offset"]) == plane["offset"]
    page.get_by_role("button", name="Open completed").click()
    expect(page.locator("#filename")).to_have_text("broken-completed.obj")
    expect(page.locator("#canvas")).to_have_attribute("data-faces", str(len(completed.faces)))


def test_copies(visit: Callable[..., Visit], server: Server) -> None:
    permitted = visit(server.url, permissions=["clipboard-read", "clipboard-write"])
    permitted.choose("Vase")
    permitted.page.get_by_text("Paper", exact=True).click()
    expect(permitted.page.locator(".results:not(.rejected) .row")).not_to_have_count(9)
    permitted.page.get_by_role("button", name="Copy JSON").click()
    expect(permitted.page.get_by_role("status")).to_have_text("JSON copied.")
    result = json.loads(permitted.page.evaluate("navigator.clipboard.readText()"))
    assert result["mesh"]["filename"] == "vase.ply"
    permitted.page.get_by_role("button", name="Copy curl line").click()
    expect(permitted.page.get_by_role("status")).to_have_text("curl line copied.")
    line = shlex.split(permitted.page.evaluate("navigator.clipboard.readText()"))
    answer = subprocess.run([line[0], "-sS", *line[1:]], cwd=EXAMPLES, capture_output=True, check=True)
    assert json.loads(answer.stdout)["planes"] == result["planes"]


def test_behind_a_path_prefix(visit: Callable[..., Visit], server: Server) -> None:
    prefix = "http://tools.test/symmetry/"
    proxied = visit(prefix, go=False)

    def forward(route: Any) -> None:
        route.fulfill(response=route.fetch(url=route.request.url.replace(prefix, f"{server.url}/")))

    proxied.page.route(f"{prefix}**", forward)
    proxied.page.goto(prefix)
    proxied.choose("Chair")
    expect(proxied.page.get_by_role("heading", name="Point group Cs")).to_be_visible()
    proxied.page.get_by_text("Heat map", exact=True).click()
    expect(proxied.page.locator("#legend")).to_contain_text("largest")


def test_light_and_dark(visit: Callable[..., Visit], server: Server) -> None:
    dark = visit(server.url, color_scheme="dark")
    ground = "getComputedStyle(document.body).backgroundColor"
    assert max(map(int, dark.page.evaluate(ground)[4:-1].split(","))) < 60
    dark.page.get_by_role("button", name="Use light colours").click()
    assert min(map(int, dark.page.evaluate(ground)[4:-1].split(","))) > 240
    dark.page.reload()
    expect(dark.page.get_by_role("button", name="Use dark colours")).to_be_visible()  # the choice is kept


def test_by_keyboard_alone(at_home: Visit) -> None:
    page = at_home.page
    page.get_by_role("button", name="Chair").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("status")).to_have_text("Done: point group Cs, 1 plane, 0 axes.")
    first = at_home.pixels()
    page.locator("#canvas").focus()
    for key in ("ArrowRight", "ArrowUp", "+"):
        page.keyboard.press(key)
    assert (np.abs(at_home.pixels() - first).max(axis=2) > 8).mean() > 0.02
    reached = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate("(e => e.textContent || e.getAttribute('aria-label') || e.id)(document.activeElement)")
        )
    assert {"Copy JSON", "Copy curl line", "Show Plane 1", "max-error", "Completed mesh"} <= reached
    page.get_by_label("Full").focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_label("Paper")).to_be_checked()
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll('button, a, input, select, canvas, progress')]
          .filter(e => !(e.textContent.trim() || e.ariaLabel || e.getAttribute('aria-label') || e.labels?.length))
          .map(e => e.outerHTML)"""
    )
    assert unnamed == []


def test_on_a_phone(visit: Callable[..., Visit], server: Server) -> None:
    phone = visit(server.url, **PHONE)
    for stage in ("start", "result"):
        if stage == "result":
            phone.choose("Vase")
        assert phone.page.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    picture, panel = (phone.page.locator(name).bounding_box() for name in ("#picture", "#panel"))
    assert picture["width"] == panel["width"] == 390
    assert panel["y"] == pytest.approx(picture["y"] + picture["height"], abs=1)
    assert picture["height"] > 250
    phone.page.get_by_role("button", name="Plane 1").first.tap()
    expect(phone.page.get_by_text("Normal")).to_be_visible()


def test_without_webgl_the_numbers_remain(browser: Any, server: Server) -> None:
    context = browser.new_context(**DEFAULT)
    context.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page = context.new_page()
    page.goto(server.url)
    page.get_by_role("button", name="Chair").click()
    expect(page.get_by_role("heading", name="Point group Cs")).to_be_visible()
    context.close()


def test_a_gltf_file_is_opened_together_with_its_buffer(at_home: Visit, tmp_path: Path) -> None:
    files = trimesh.Scene(trimesh.creation.box((1, 2, 3))).export(file_type="gltf")
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    names = sorted(files, key=lambda name: name.endswith(".gltf"))  # the mesh last: the order plays no role
    at_home.page.locator("#file").set_input_files([tmp_path / name for name in names])
    expect(at_home.page.locator("#filename")).to_have_text("model.gltf")
    expect(at_home.page.locator("#panel")).to_contain_text("D2h")
    at_home.page.locator("#file").set_input_files([tmp_path / "model.gltf"])
    expect(at_home.problem()).to_contain_text("another file")
    at_home.errors.clear()  # the browser's own words about the refusal


def test_a_mesh_with_colours_is_shown_in_them(at_home: Visit, tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 2, 3))
    box.visual.vertex_colors = [220, 20, 20, 255]
    box.export(tmp_path / "red.ply")
    at_home.open(tmp_path / "red.ply")
    expect(at_home.page.locator("#panel")).to_contain_text("D2h")
    middle = at_home.pixels()
    red = (middle[..., 0] > 1.5 * middle[..., 1] + 20) & (middle[..., 0] > 1.2 * middle[..., 2])
    assert red.mean() > 0.02


def test_where_nothing_is_found_the_best_candidate_is_told(at_home: Visit) -> None:
    at_home.choose("Plant")
    words = at_home.page.locator(".nearest")
    expect(words).to_contain_text("The best candidate is")
    least = float(words.inner_text().rstrip(".").split()[-1])
    assert 4e-4 < least < 0.1


def test_long_lists_are_folded_by_kind(at_home: Visit) -> None:
    at_home.choose("Icosahedral star")
    page = at_home.page
    planes = page.get_by_role("region", name="Planes")
    kinds = planes.locator("details.kind")
    counts = [int(text) for text in kinds.locator("summary .count").all_inner_texts()]
    assert (len(counts) > 1, sum(counts)) == (True, 15)
    expect(planes.locator(".row").first).to_be_hidden()
    kinds.first.locator("summary").click()
    expect(planes.locator(".row").first).to_be_visible()
    expect(kinds.first.locator("summary")).to_contain_text("error up to")
    assert sum(map(int, page.get_by_role("region", name="Axes").locator("details .count").all_inner_texts())) == 31


def test_other_downloads(at_home: Visit) -> None:
    at_home.choose("Hexagonal nut")
    page = at_home.page
    contents: dict[str, bytes] = {}
    page.get_by_label("Format of the completed mesh").select_option("ply")
    for button in ("CSV", "BOP", "Half", "Sector", "Aligned copy", "Picture"):
        with page.expect_download() as event:
            page.get_by_role("button", name=button, exact=True).click()
        contents[event.value.suggested_filename] = Path(event.value.path()).read_bytes()
    assert set(contents) == {
        "nut-symmetries.csv", "nut-symmetries.json", "nut-half.ply", "nut-sector.ply", "nut-aligned.ply", "nut.png"
    }  # fmt: skip
    assert contents["nut-symmetries.csv"].count(b"plane") >= 7
    assert json.loads(contents["nut-symmetries.json"])["diameter"] > 0
    whole, half = (
        trimesh.load_mesh(BytesIO(contents[f"nut-{name}.ply"]), file_type="ply") for name in ("aligned", "half")
    )
    assert half.area < 0.6 * whole.area
    assert np.allclose(whole.bounds.sum(axis=0), 0.0, atol=1e-5 * whole.scale)
    picture = np.asarray(Image.open(BytesIO(contents["nut.png"])).convert("RGB"))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100


def test_a_sector_comes_with_lines_for_simulation_programs(visit: Callable[..., Visit], server: Server) -> None:
    at_home = visit(server.url, permissions=["clipboard-read", "clipboard-write"])
    at_home.choose("Icosahedral star")
    page = at_home.page
    page.get_by_label("Format of the completed mesh").select_option("ply")
    page.get_by_label("close the cuts").check()
    expect(page.get_by_role("button", name="Copy for CalculiX")).to_be_hidden()
    with page.expect_download() as event:
        page.get_by_role("button", name="Sector", exact=True).click()
    sector = trimesh.load_mesh(event.value.path(), file_type="ply")
    assert sector.is_watertight
    expect(page.locator(".outcome")).to_contain_text("one of 5, 72°")
    page.get_by_role("button", name="Copy for CalculiX").click()
    expect(page.locator(".toast, [role=status]").first).to_contain_text("CalculiX")
    assert "*CYCLIC SYMMETRY MODEL, N=5" in page.evaluate("navigator.clipboard.readText()")
    page.get_by_role("button", name="Copy for FreeCAD").click()
    page.wait_for_function("navigator.clipboard.readText().then(text => text.includes('tie.Sectors = 5'))")
    # About a chosen axis: a half turn has two sectors.
    page.locator(".row", has_text="2-fold").first.locator("button").first.dispatch_event("click")  # folded
    with page.expect_download():
        page.get_by_role("button", name="Sector", exact=True).click()
    expect(page.locator(".outcome")).to_contain_text("one of 2, 180°")


def test_a_link_brings_back_an_example_with_its_options(visit: Callable[..., Visit], server: Server) -> None:
    first = visit(server.url, permissions=["clipboard-read", "clipboard-write"])
    first.choose("Vase")
    first.page.get_by_text("Paper", exact=True).click()
    expect(first.page.locator(".results:not(.rejected) .row")).not_to_have_count(9)
    first.page.get_by_role("button", name="Copy link").click()
    expect(first.page.get_by_role("status")).to_have_text("Link copied.")
    second = visit(first.page.evaluate("navigator.clipboard.readText()"))
    second.url = server.url
    expect(second.page.locator("#filename")).to_have_text("vase.ply")
    expect(second.page.get_by_label("Paper")).to_be_checked()
    assert "mode=paper" in second.detections()[-1]


def test_a_click_on_an_axis_looks_along_it(at_home: Visit) -> None:
    at_home.choose("Chair")
    first = at_home.pixels()
    seen = []
    for name in "xyz":
        at_home.page.get_by_role("button", name=f"Look from {name}").click()
        at_home.page.mouse.move(0, 0)
        seen.append(at_home.pixels())
        assert (np.abs(seen[-1] - first).max(axis=2) > 8).mean() > 0.02
    front = seen[2]  # the chair's plane is x = const: from z its two halves are seen side by side
    assert (np.abs(front - seen[0]).max(axis=2) > 8).mean() > 0.02
