"""Visits to the viewer in a real browser: what its tests share."""

from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

sync_api = pytest.importorskip("playwright.sync_api")

from .browser import CHROMIUM, REQUIRED  # noqa: E402

if CHROMIUM is None and not REQUIRED:
    pytest.skip("no Chromium is installed", allow_module_level=True)

expect = sync_api.expect
expect.set_options(timeout=60_000)  # the machines that run tests are busy with other things too
DEFAULT = {"viewport": {"width": 1000, "height": 640}}
EXAMPLES = Path(__file__).parents[2] / "app" / "viewer" / "examples"


@dataclass
class Visit:
    """One visit to the viewer, and everything that went wrong in it."""

    page: Any
    url: str
    errors: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def choose(self, example: str) -> None:
        self.page.get_by_role("button", name=example).click()
        expect(self.page.locator("#panel")).to_be_visible()
        self.page.mouse.move(0, 0)

    def open(self, path: Path) -> None:
        self.page.locator("#file").set_input_files(path)
        expect(self.page.locator("#filename")).to_have_text(path.name)

    def shown(self) -> list[str]:
        """Ids of the planes and axes in the picture."""
        return [name for name in self.page.locator("#canvas").get_attribute("data-shown").split(",") if name]

    def expect_shown(self, *names: str) -> None:
        expect(self.page.locator("#canvas")).to_have_attribute("data-shown", ",".join(names))

    def pixels(self) -> Any:
        """The canvas as (height, width, 3) numbers from 0 to 255, once what changed is drawn."""
        self.page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        image = Image.open(BytesIO(self.page.locator("#canvas").screenshot())).convert("RGB")
        return np.asarray(image).astype(int)

    def problem(self) -> Any:
        return self.page.get_by_role("alert")

    def detections(self) -> list[str]:
        """Queries of the requests to /detect so far."""
        return [address.partition("?")[2] for address in self.asked if "/detect" in address]
