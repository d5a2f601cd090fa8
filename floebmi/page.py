"""The page with a slider for the time: what `view.html` shows of a run, in one file."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

from floebmi.canvas import INK, LAND, WATER
from floebmi.picture import FloePicture
from floebmi.reading import View, shores


def write_page(path: Path, run: dict[str, Any]) -> None:
    """`view.html` with that run in it."""
    blank = Path(__file__).with_name("view.html").read_text(encoding="utf-8")
    # "</" would end the script that holds the data
    told = json.dumps(run, ensure_ascii=False).replace("</", "<\\/")
    path.write_text(blank.replace("{{ run }}", told), encoding="utf-8")


def page_of(picture: FloePicture, view: View, every: int) -> dict[str, Any]:
    """What `view.html` shows; lengths in m, arrays (frame, floe) in base 64: float32, and RGB as bytes.

    Places are those from the south-western corner, since float32 has seven digits.
    """
    from matplotlib.colors import to_hex, to_rgb

    data, bar = view.data, picture.bar
    frames = range(0, len(view.times.seconds), every)
    (west, east), (south, north) = data.domain_x, data.domain_y
    x, y = (
        np.array([picture.read(name, k) - corner for k in frames], "<f4")
        for name, corner in (("x", west), ("y", south))
    )
    rgb = np.array([bar.scale.cmap(bar.scale.norm(picture.values(k)), bytes=True) for k in frames])
    rgb[:, picture.still, :3] = np.round(255 * np.array(to_rgb(LAND)))
    walls = []
    if "wall_position" in data.variables:
        positions = data["wall_position"][::every].T
        walls = [
            {
                "edge": str(edge),
                "position": (position - (west if edge in ("west", "east") else south)).tolist(),
            }
            for edge, position in zip(data["wall"][:], positions, strict=True)
        ]
    low, high = bar.scale.norm.vmin, bar.scale.norm.vmax
    # three digits of the difference
    apart = max(abs(low), abs(high)) / (high - low)
    digits = 3 + int(np.log10(apart)) if apart > 1.0 else 3
    length, unit = view.length
    return {
        "title": picture.title,
        "box": [0.0, float(east - west), 0.0, float(north - south)],
        "width": f"{(east - west) / length:g} {unit}",
        "period": [
            float(high - low) if edge == "periodic" else 0.0
            for edge, low, high in (
                (data.domain_west, west, east), (data.domain_south, south, north)
            )
        ],
        "times": [view.times.text(k) for k in frames],
        "radius": np.nan_to_num(picture.read("radius", len(view.times.seconds) - 1)).tolist(),
        "still": picture.still.tolist(),
        "x": _base64(x), "y": _base64(y), "rgb": _base64(rgb[:, :, :3]),
        "shores": [(ring - (west, south)).tolist() for ring in shores(data)],
        "walls": walls,
        "bar": {
            "low": f"{low:.{digits}g}", "high": f"{high:.{digits}g}", "label": bar.label,
            "colours": [to_hex(bar.scale.cmap(share)) for share in np.linspace(0, 1, 9)],
        },
        "water": WATER, "land": LAND, "ink": INK,
    }  # fmt: skip


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
