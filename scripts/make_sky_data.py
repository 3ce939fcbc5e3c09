"""Writes clrender/flatten/hosek_wilkie.npz, the data of the sky model, from a file with the published data sets.

Run ``python scripts/make_sky_data.py sunsky_datasets.bin`` to write it: the file is part of Mitsuba 3 (`mitsuba/data/
sunsky`) and holds the data of Hošek's and Wilkie's own program, whose licence is clrender/flatten/hosek_wilkie.txt.
With ``--check`` it is compared with what is committed.

sky_parameters   (10, 2, 6, 3, 9) float32   turbidity, albedo of the ground, control point, channel, parameter
sky_radiance     (10, 2, 6, 3) float32      W/(sr m2), the mean, a factor of the radiance
sun_radiance     (10, 45, 11, 4) float32    turbidity, piece of the elevation, wavelength, power: W/(sr m2 nm)
sun_darkening    (11, 6) float32            wavelength, power of the cosine: share of the disc's central radiance
"""

from __future__ import annotations

import io
import math
import struct
import sys
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
PATH = ROOT / "clrender" / "flatten" / "hosek_wilkie.npz"
NAMES = {
    "sky_parameters": "sky_params_rgb",
    "sky_radiance": "sky_rad_rgb",
    "sun_radiance": "sun_rad_spec",
    "sun_darkening": "sun_ld_spec",
}
_DOUBLE = 11
_BEGIN = b"tensor_file\0"


def read(data: bytes) -> dict[str, NDArray[np.float64]]:
    """The arrays of such a file."""
    if not data.startswith(_BEGIN):
        raise SystemExit("the file is not one of Mitsuba's tensor files")
    at, fields = len(_BEGIN) + 2, {}
    (count,) = struct.unpack_from("<I", data, at)
    at += 4
    for _ in range(count):
        (length,) = struct.unpack_from("<H", data, at)
        name = data[at + 2 : at + 2 + length].decode()
        at += 2 + length
        dimensions, kind, offset = struct.unpack_from("<HBQ", data, at)
        shape = struct.unpack_from(f"<{dimensions}Q", data, at + 11)
        at += 11 + 8 * dimensions
        if kind == _DOUBLE:
            fields[name] = np.frombuffer(data, "<f8", math.prod(shape), offset).reshape(shape)
    return fields


def packed(fields: dict[str, NDArray[np.float64]]) -> bytes:
    """The bytes of the .npz, without a date, so that they are reproducible."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, theirs in NAMES.items():
            array = io.BytesIO()
            np.save(array, fields[theirs].astype("<f4"))
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), array.getvalue(), zipfile.ZIP_DEFLATED)
    return out.getvalue()


def main() -> int:
    """Write the file, or with ``--check`` compare it with the result for the given file."""
    arguments = [each for each in sys.argv[1:] if each != "--check"]
    if len(arguments) != 1:
        raise SystemExit("give the path of sunsky_datasets.bin")
    data = packed(read(Path(arguments[0]).read_bytes()))
    if "--check" not in sys.argv:
        PATH.write_bytes(data)
    elif PATH.read_bytes() != data:
        print(f"{PATH} is stale; run `python scripts/make_sky_data.py`")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
