"""Makes the viewer's pictures from the running product: `python -m docs.make_screenshots`, from the repository's root.

Those for README and docs go to docs/images; with `--examples` also the small ones of the start page, which stand in
app/viewer/examples (run `make viewer` afterwards).
"""

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser, Page

from tests.e2e.browser import PHONE, chromium
from tests.e2e.server import running

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
EXAMPLES = ROOT / "app" / "viewer" / "examples"
DESKTOP = {"width": 1280, "height": 800}
THUMBNAIL = 144, 120
MESHES = (".obj", ".ply", ".stl", ".glb", ".off", ".3mf")


@contextmanager
def opened(browser: Browser, url: str, **options: Any) -> Iterator[Page]:
    """The viewer in a browser of its own."""
    context = browser.new_context(**({"viewport": DESKTOP, "device_scale_factor": 1.5} | options))
    page = context.new_page()
    page.goto(url)
    page.wait_for_load_state("networkidle")
    yield page
    context.close()


def choose(page: Page, example: str) -> None:
    """Open one of the examples and wait for its results."""
    page.get_by_role("button", name=example).click()
    page.locator("#panel").wait_for(timeout=60_000)
    settle(page)


def settle(page: Page) -> None:
    """Until the picture is drawn: twice the next frame, and the pointer out of the way."""
    page.mouse.move(0, 0)
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.wait_for_timeout(400)


def save(page: Page, name: str) -> None:
    """The page as a picture."""
    Image.open(BytesIO(page.screenshot())).convert("RGB").save(IMAGES / f"{name}.webp", quality=92, method=6)
    print(name)


def heat(page: Page) -> None:
    """The heat map, measured."""
    page.get_by_text("Heat map", exact=True).click()
    page.locator("#legend", has_text="largest").wait_for(timeout=60_000)
    settle(page)


def screenshots(browser: Browser, url: str) -> None:
    """Those of README and docs."""
    with opened(browser, url) as page:
        save(page, "viewer_start")
        choose(page, "Hexagonal nut")
        save(page, "viewer_light")
    with opened(browser, url, color_scheme="dark") as page:
        choose(page, "Propeller")
        page.get_by_role("button", name="Axis 1").first.click()
        settle(page)
        save(page, "viewer_dark")
    with opened(browser, url) as page:
        choose(page, "Damaged table")
        page.get_by_role("button", name="Plane 2").first.click()
        heat(page)
        save(page, "viewer_heat")
        page.get_by_text("Mirror preview", exact=True).click()
        settle(page)
        save(page, "viewer_mirror")
    with opened(browser, url) as page:
        files = [EXAMPLES / name for name in ("broken.3mf", "vase.ply", "propeller.stl", "nut.glb", "plant.off")]
        page.locator("#file").set_input_files(files)
        page.get_by_role("heading", name="5 files").wait_for(timeout=60_000)
        page.locator(".row").first.wait_for(timeout=60_000)
        page.get_by_text("Drawing").click()
        for label in ("Orthographic", "Grid"):
            page.get_by_label(label).check()
        settle(page)
        save(page, "viewer_files")
    with opened(browser, url, **PHONE, device_scale_factor=2) as page:
        choose(page, "Vase")
        save(page, "viewer_phone")


def thumbnails(browser: Browser, url: str) -> None:
    """One of every example, its mesh alone on nothing, for light and dark ground alike."""
    for path in sorted(EXAMPLES.iterdir()):
        if path.suffix not in MESHES:
            continue
        square = {"viewport": {"width": 1000, "height": 700}, "bypass_csp": True, "device_scale_factor": 1}
        with opened(browser, url, **square) as page:
            page.locator("#file").set_input_files(path)
            page.locator("#panel").wait_for(timeout=60_000)
            page.add_style_tag(
                content="* { background: none !important } .overlay, .panel, .bar { visibility: hidden }"
            )
            page.evaluate("document.querySelectorAll('.eye[aria-pressed=true]').forEach(button => button.click())")
            settle(page)
            shot = page.locator("#canvas").screenshot(omit_background=True)
        picture = Image.open(BytesIO(shot))
        picture = picture.crop(picture.getbbox())
        picture.thumbnail(THUMBNAIL, Image.Resampling.LANCZOS)
        picture.quantize(64, method=Image.Quantize.FASTOCTREE).save(EXAMPLES / f"{path.name}.png", optimize=True)
        print(path.name)


def main() -> None:
    """Start the service, take the pictures."""
    with tempfile.TemporaryDirectory() as folder, running(Path(folder) / "log") as server, chromium() as browser:
        if "--examples" in sys.argv:
            thumbnails(browser, server.url)
        else:
            screenshots(browser, server.url)


if __name__ == "__main__":
    main()
