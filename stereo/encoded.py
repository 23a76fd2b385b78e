"""Images as files hold them and cameras send them: encoded bytes made into pixels."""

from __future__ import annotations

import numpy as np

# The end mark of a PNG or JPEG stands in so many last bytes: some cameras pad their files.
TAIL = 4096
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"


def is_cut_short(head: bytes, tail: bytes) -> bool:
    """Whether a PNG or JPEG lacks its end; head: its first bytes, tail: the last `TAIL`."""
    return (head.startswith(b"\x89PNG") and b"IEND" not in tail) or (
        head.startswith(JPEG_START) and JPEG_END not in tail
    )


def decode_image(data: bytes) -> np.ndarray | str:
    """uint8 (H, W), or (H, W, 3) BGR when it is in colour; or what is wrong with it, in words.

    OpenCV itself returns a half-grey picture for a file that is cut short.
    """
    import cv2

    if is_cut_short(data[:8], data[-TAIL:]):
        return "cut short"
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR) if data else None
    except cv2.error:
        image = None
    return "not a readable image" if image is None else image
