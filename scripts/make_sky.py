"""Writes scenes/sky.hdr, a clear sky with a low sun; it is committed, and the same bytes come out on every machine.

Run ``python scripts/make_sky.py`` to write it, with ``--check`` to compare it with what is committed.
"""

from __future__ import annotations

import argparse
import io
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from clrender.exact.angles import sin_cos_degrees  # noqa: E402
from clrender.image.radiance_hdr import write_hdr  # noqa: E402

__all__ = ["main", "sky"]

WIDTH, HEIGHT = 128, 64
SUN = (25.0, 20.0)
"""Elevation of the sun, and azimuth from +z towards +x, degrees."""


def sky() -> NDArray[np.float32]:
    """The map, (HEIGHT, WIDTH, 3), W/(sr m2); uses only sums and products, which every machine rounds alike."""
    rows = [sin_cos_degrees(90.0 - (y + 0.5) * 180.0 / HEIGHT) for y in range(HEIGHT)]
    columns = [sin_cos_degrees(180.0 - (x + 0.5) * 360.0 / WIDTH) for x in range(WIDTH)]
    up = np.array([sine for sine, _ in rows])[:, None]
    level = np.array([cosine for _, cosine in rows])[:, None]
    sine, cosine = (np.array([each[i] for each in columns])[None, :] for i in (0, 1))
    sun_up, sun_level = sin_cos_degrees(SUN[0])
    sun_sine, sun_cosine = sin_cos_degrees(SUN[1])
    facing = up * sun_up + level * sun_level * (sine * sun_sine + cosine * sun_cosine)
    haze = np.maximum(1.0 - np.maximum(up, 0.0), 0.0)
    for _ in range(2):
        haze = haze * haze
    glow = np.maximum(facing, 0.0)
    for _ in range(5):
        glow = glow * glow
    ground = np.where(up < 0.0, 1.0, 0.0)[..., None]
    blue, white, warm = np.array([0.16, 0.32, 0.75]), np.array([0.75, 0.85, 1.0]), np.array([1.6, 1.2, 0.8])
    picture = (blue + (white - blue) * haze[..., None]) + warm * glow[..., None]
    picture = picture * (1.0 - ground) + np.array([0.16, 0.14, 0.11]) * ground
    y, x = np.unravel_index(int(facing.argmax()), facing.shape)
    picture[y, x] = (2400.0, 2100.0, 1700.0)  # the sun, spread over a pixel
    result: NDArray[np.float32] = picture.astype(np.float32)
    return result


def main() -> int:
    """Write or check the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    check = parser.parse_args().check
    data = io.BytesIO()
    write_hdr(data, sky())
    path = ROOT / "scenes" / "sky.hdr"
    if not check:
        path.write_bytes(data.getvalue())
    elif path.read_bytes() != data.getvalue():
        print(f"{path} is stale; run `python scripts/make_sky.py`")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
