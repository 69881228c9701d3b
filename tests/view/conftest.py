"""A real browser, and pictures of what it shows."""

import base64
import io
import os
import shutil
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import umsgpack
from PIL import Image
from scipy import ndimage

from k1607_pin.view.offline import Recorder
from k1607_pin.view.scene import Scene

SIZE = {"width": 720, "height": 560}
ARGUMENTS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
]
NAMES = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium. Without one the tests are skipped on a desk, and fail in CI."""
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        reason = f"no browser: none of {', '.join(NAMES)} on the path"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield chromium
        chromium.close()


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A fresh page that keeps the address of every request in ``page.requested`` and each error in ``page.errors``."""
    page = browser.new_page(viewport=SIZE)
    page.set_default_timeout(600_000)  # ms: what is waited for comes, however busy the machine is
    page.requested, page.errors = [], []
    page.on("request", lambda request: page.requested.append(request.url))
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    yield page
    page.close()


@pytest.fixture
def picture(page: Any) -> Callable[[], np.ndarray]:
    """Takes (height, width, 3) uint8 of the page as it is once drawn, without the viewer's own controls."""

    def take() -> np.ndarray:
        page.evaluate(
            """() => new Promise((done) => {
                viewer.gui.domElement.style.display = "none";
                viewer.set_dirty();
                requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done)));
            })"""
        )
        return np.array(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))

    return take


@pytest.fixture
def switch(page: Any) -> Callable[[str, bool], None]:
    """Shows or hides a node of the scene by its path."""

    def switch(path: str, visible: bool) -> None:
        page.evaluate("([path, on]) => viewer.set_property(path, 'visible', on)", [path.split("/"), visible])

    return switch


@pytest.fixture
def pixels_of(
    picture: Callable[[], np.ndarray], switch: Callable[[str, bool], None], differ: Callable[..., np.ndarray]
) -> Callable[[str], np.ndarray]:
    """Takes (height, width) bool: the pixels that a node of the scene puts on the screen."""

    def take(path: str) -> np.ndarray:
        switch(path, False)
        without = picture()
        switch(path, True)
        return differ(picture(), without)

    return take


@pytest.fixture
def differ() -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """(height, width) bool: where two pictures differ by more than noise."""
    return lambda a, b: np.abs(a.astype(int) - b).max(axis=2) > 12


def _shown(mask: np.ndarray) -> bool:
    """Whether a mask is one large thing, wholly in the picture and around its middle."""
    labels, count = ndimage.label(mask, structure=np.ones((3, 3)))
    if count == 0:
        return False
    largest = labels == 1 + np.argmax(np.bincount(labels.flat)[1:])
    rows, columns = np.nonzero(largest)
    height, width = mask.shape
    return bool(
        largest.sum() > 0.9 * mask.sum()
        and 0.02 < largest.mean() < 0.5
        and max(np.ptp(rows) / height, np.ptp(columns) / width) > 0.5
        and rows.min() > 0
        and rows.max() < height - 1
        and columns.min() > 0
        and columns.max() < width - 1
        and abs((rows.min() + rows.max()) / 2 / height - 0.5) < 0.1
        and abs((columns.min() + columns.max()) / 2 / width - 0.5) < 0.1
    )


@pytest.fixture
def shown() -> Callable[[np.ndarray], bool]:
    """The check that a mask of pixels is an arm as one wants to see it."""
    return _shown


class Drawn:
    """What a scene with a run has sent: objects and tracks by their path below /meshcat/run."""

    def __init__(self, arm, run, wall=None):
        window = Recorder()
        self.scene = Scene(arm, window)
        self.scene.play(run, wall=wall)
        self.sent = [umsgpack.unpackb(data) for data in window._commands.values()]
        self.objects = {x["path"]: x["object"] for x in self.sent if x["type"] == "set_object"}
        (animation,) = (x for x in self.sent if x["type"] == "set_animation")
        self.clips = {
            clip["path"]: {
                track["name"]: (floats(track["times"]), floats(track["values"])) for track in clip["clip"]["tracks"]
            }
            for clip in animation["animations"]
        }

    def track(self, node, name):
        return self.clips[f"/meshcat/run/{node}"][name]

    @property
    def legend(self):
        (image,) = self.objects["/Cameras/default/rotated/<object>/legend"]["images"]
        return base64.b64decode(image["url"].partition(",")[2]).decode()

    def vertices(self, node):
        (geometry,) = self.objects[f"/meshcat/run/{node}"]["geometries"]
        return floats(geometry["data"]["attributes"]["position"]["array"]).reshape(-1, 3)


def floats(values):
    return np.frombuffer(values.data, "<f4") if isinstance(values, umsgpack.Ext) else np.array(values)


@pytest.fixture(scope="session")
def draw() -> type[Drawn]:
    """Draws a run: arm, run, wall -> what the scene has sent."""
    return Drawn


@pytest.fixture
def scrub(page: Any) -> Callable[[float], None]:
    """Moves the viewer's slider to a time [s]."""
    return lambda seconds: page.evaluate(
        "(t) => { viewer.animator.pause(); viewer.animator.time_scrubber.setValue(t); }", seconds
    )


@pytest.fixture
def count() -> Callable[..., int]:
    """How many pixels (K, 3) have a colour: ((lowest, highest hue), least saturation)."""
    return _count


def _count(pixels, colour):
    import matplotlib.colors

    (low, high), least = colour
    hue, saturation, _ = np.moveaxis(matplotlib.colors.rgb_to_hsv(pixels / 255), -1, 0)
    return int(((hue > low) & (hue < high) & (saturation > least)).sum())
