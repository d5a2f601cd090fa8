"""Films: a run's frames, drawn one by one, as .mp4 or .gif.

An .mp4 is piped to the ffmpeg binary that PyPI's imageio-ffmpeg brings; matplotlib's own writers would look for
one on the user's path.
"""

import errno
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

FASTEST_GIF = 50  # frames a second: a GIF counts hundredths of a second, and players slow down those of less than two


def write_mp4(path: Path, images: Iterator[np.ndarray], fps: int) -> None:
    import imageio_ffmpeg

    first = next(images)
    height, width = first.shape[:2]
    pipe = imageio_ffmpeg.write_frames(
        path, (width, height), fps=fps, codec="libx264", quality=None, macro_block_size=2,
        output_params=["-crf", "20", "-movflags", "+faststart", "-f", "mp4"], ffmpeg_log_level="quiet",
    )  # fmt: skip
    pipe.send(None)
    sent, whole = 0, True
    try:
        for image in chain([first], images):
            pipe.send(image)
            sent += 1
    except OSError:  # ffmpeg has ended
        whole = False
    finally:
        pipe.close()
    if not whole or _frames_in(path) != sent:  # what went wrong at the end, ffmpeg does not tell
        with open(path, "ab", buffering=0) as file:  # the system does
            file.write(bytes(1 << 20))
        raise OSError(errno.EIO, "ffmpeg could not write the film: is the disk full?")


def _frames_in(film: Path) -> int:
    import imageio_ffmpeg

    try:
        return imageio_ffmpeg.count_frames_and_secs(film)[0]
    except RuntimeError:  # it is torn
        return 0


def write_gif(path: Path, images: Iterator[np.ndarray], fps: int) -> None:
    from PIL import Image

    def indexed(image: np.ndarray) -> "Image.Image":
        # of all colours, also those of few pixels: the colour scale, and floes unlike the others
        method = Image.Quantize.MAXCOVERAGE
        return Image.fromarray(image).quantize(255, method, dither=Image.Dither.NONE)

    first = indexed(next(images))
    first.save(
        path,
        format="GIF",
        save_all=True,
        append_images=(indexed(image) for image in images),
        duration=round(1000 / fps),
        loop=0,
    )
