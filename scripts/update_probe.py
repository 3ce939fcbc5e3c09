"""Write the hash of the probe's tile after a change of the kernels: `python scripts/update_probe.py`.

Renders the tile on every driver of the machine; nothing is written unless they all agree.
"""

from __future__ import annotations

import sys
from dataclasses import asdict

from clrender.drivers.discover import drivers
from clrender.drivers.probe import EXPECTED_FILE, ask_child, inventory

__all__: list[str] = []


def main() -> int:
    """Write the file; returns 0 if all drivers agree."""
    hashes: dict[str, str] = {}
    for info in inventory(refresh=True):
        driver = next(each for each in drivers() if each.library == info.library)
        answer = ask_child({"task": "probe", "driver": asdict(driver), "ordinal": info.ordinal}, 600.0)
        value = answer.value or {"error": f"{answer.failure}: {answer.detail}"}
        print(f"{info.title}: {value.get('hash') or value.get('error')}")
        if "hash" in value:
            hashes[info.title] = value["hash"]
    if len(set(hashes.values())) != 1:
        print("nothing written: the drivers do not agree, or there is none", file=sys.stderr)
        return 1
    EXPECTED_FILE.write_text(f"{next(iter(hashes.values()))}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
