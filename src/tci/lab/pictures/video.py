"""Saves pictures as an MP4 video for browsers and slides (extra `video`: PyAV)."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image

from tci.support.installed import needs

QUALITY = "20"
"""Constant rate factor of x264, from 0 (lossless) to 51 (worst quality). Assumed: the quality should be
better than with x264's default of 23."""


def needs_video() -> None:
    """Raises MissingExtraError if the extra `video` is not installed."""
    with needs("a film as MP4", "video"):
        import av  # noqa: F401 - only to see that it is there


def save_video(path: Path, pictures: Sequence[Image.Image], *, shown: float, last: float) -> None:
    """Writes pictures to a video. Each picture is shown for `shown` [s], and the last picture for `last` [s].

    All pictures have one size, with an even width and height. Raises MissingExtraError if the extra `video`
    is not installed.
    """
    needs_video()
    import av

    codec: Literal["libx264"] = "libx264"
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, Fraction(1 / shown).limit_denominator(1000), options={"crf": QUALITY})
        stream.width, stream.height = pictures[0].size
        stream.pix_fmt = "yuv420p"  # all players support this pixel format
        for picture in [*pictures, *[pictures[-1]] * (round(last / shown) - 1)]:
            frame = av.VideoFrame.from_ndarray(np.asarray(picture.convert("RGB")), format="rgb24")
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
