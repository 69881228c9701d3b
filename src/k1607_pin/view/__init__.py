"""Arms in 3-D: a page in a file, a notebook cell, or live in the browser."""

from k1607_pin.view.scene import Scene
from k1607_pin.view.show import LiveView, html, notebook, save_html, show

__all__ = ["LiveView", "Scene", "html", "notebook", "save_html", "show"]
