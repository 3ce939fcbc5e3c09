"""Writes scenes/scallop.ies, a lamp for walls; it is committed, and the same bytes come out on every machine.

Run ``python scripts/make_lamps.py`` to write it, with ``--check`` to compare it with what is committed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from clrender.exact.angles import sin_cos_degrees  # noqa: E402

__all__ = ["main", "scallop"]

HEAD = """IESNA:LM-63-2002
[TEST] none: these numbers are made by a formula (clrender, scripts/make_lamps.py)
[TESTLAB] none
[ISSUEDATE] none
[MANUFAC] none
[LUMINAIRE] a reflector with two lobes, and a ring around them
TILT=NONE
"""


def candela(vertical: float, horizontal: float) -> float:
    """A lobe 16 degrees off the axis, towards 0 and towards 180; a ring at 40 degrees; nothing beyond 75."""
    sine, cosine = sin_cos_degrees(vertical)
    x, y = (sine * each for each in sin_cos_degrees(horizontal)[::-1])
    lobe_sine, lobe_cosine = sin_cos_degrees(16.0)
    lobes = 0.0
    for side in (1.0, -1.0):
        near = max(1.0 - 16.0 * ((x - side * lobe_sine) ** 2 + y * y + (cosine - lobe_cosine) ** 2), 0.0)
        lobes += near * near
    ring = max(1.0 - ((vertical - 40.0) / 7.0) ** 2, 0.0)
    edge = max(1.0 - (vertical / 75.0) ** 2, 0.0)
    return 2400.0 * lobes + 260.0 * ring + 180.0 * edge


def scallop() -> str:
    """The file: quadrants, at every 2.5 and every 15 degrees."""
    vertical, horizontal = [2.5 * k for k in range(37)], [15.0 * k for k in range(7)]
    numbers = f"1 -1 1 {len(vertical)} {len(horizontal)} 1 2 0 0 0\n1 1 12\n"
    rows = [vertical, horizontal, *([candela(v, h) for v in vertical] for h in horizontal)]
    lines = []
    for row in rows:
        words = [f"{value:.1f}".rstrip("0").rstrip(".") for value in row]
        lines += [" ".join(words[at : at + 19]) for at in range(0, len(words), 19)]
    return HEAD + numbers + "\n".join(lines) + "\n"


def main() -> int:
    """Write the file, or compare with it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with what is committed, and write nothing")
    check = parser.parse_args().check
    path = ROOT / "scenes" / "scallop.ies"
    if not check:
        path.write_text(scallop())
    elif path.read_text() != scallop():
        print(f"{path} is stale; run `python scripts/make_lamps.py`")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
