"""Pages from their templates: one file each, with everything in it."""

from __future__ import annotations

import base64
from importlib import resources
from typing import Any

import jinja2
import numpy as np

BASE = "pipeline.pages"


def render(package: str, template: str, **values: Any) -> str:
    """The page that a template of `package` makes of the values; it may extend base.html.j2.

    What is put in is escaped, and a name that the values lack is an error.
    """

    def text(name: str) -> str | None:
        for place in (package, BASE):
            file = resources.files(place).joinpath(name)
            if file.is_file():
                return file.read_text(encoding="utf-8")
        return None

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(text),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(template).render(**values)


def jpeg_uri(picture: np.ndarray, quality: int = 80) -> str:
    """A picture, (H, W) or BGR (H, W, 3) uint8, as text for a page."""
    import cv2

    return _uri("jpeg", cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def png_uri(picture: np.ndarray) -> str:
    """A picture without loss, also with transparency (H, W, 4) BGRA, as text for a page."""
    import cv2

    return _uri("png", cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1])


def _uri(kind: str, data: np.ndarray) -> str:
    return f"data:image/{kind};base64," + base64.b64encode(data.tobytes()).decode("ascii")
