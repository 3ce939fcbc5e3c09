"""Make the table, plot and images of docs/speed.md. Arguments: `pictures`, or files with the output of `scripts/bench`.

Lines of a benchmark replace those in docs/speed.json for the same scenes and renderers:

    scripts/bench S1 S2 S1-tess S3-10k S3-1M S3-4M S4 S5 > speed.jsonl
    scripts/bench S1 S2 S4 S5 --errors --size 100x100 --spp 64 > errors.jsonl
    python scripts/speed_docs.py speed.jsonl errors.jsonl
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from made_part import with_part

from clrender.bench import SCENES
from clrender.drawing.svg import BLUE, ORANGE
from clrender.report.plots import Series, plot

__all__ = ["current"]

_DOCS: Final = Path(__file__).resolve().parents[1] / "docs"
_GROWTH: Final = {"S3-10k": 9_680, "S3-1M": 1_003_520, "S3-4M": 3_996_180}
"""Scenes of the plot, and their triangles."""
_ROWS: Final = ("S1", "S2", "S1-tess", "S3-10k", "S3-1M", "S3-4M", "S4", "S5", "S6")
_NONE: Final = "–"


def main() -> int:
    """Store new lines, if given, and rewrite the page."""
    if sys.argv[1:] == ["pictures"]:
        _pictures()
        return 0
    data = json.loads((_DOCS / "speed.json").read_text())
    for name in sys.argv[1:]:
        _take(data, [json.loads(line) for line in Path(name).read_text().splitlines() if line.startswith("{")])
    rates = [data["scenes"][scene].get(name, {}) for scene in _GROWTH for name in ("clrender", "mitsuba")]
    if all("mpaths_per_second" in each for each in rates) and data.pop("growth", None):
        print("the growth is now that of the table's machine: say so in docs/speed.md")
    (_DOCS / "speed.json").write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n")
    page = _DOCS / "speed.md"
    page.write_text(current(page.read_text(), data))
    (_DOCS / "speed-growth.svg").write_text(_growth(data))
    return 0


def current(page: str, data: dict[str, Any]) -> str:
    """The page with its table updated.

    Parameters
    ----------
    page : str
        Text with the two marks around the table.
    data : dict
        Content of docs/speed.json.
    """
    return with_part(page, "speed_docs.py:", f"{_table(data)}\n")


def _take(data: dict[str, Any], lines: list[dict[str, Any]]) -> None:
    """Update the data with the medians and ranges of a benchmark's lines."""
    judged = all("rel_mse" in line for line in lines)
    for scene, renderer in dict.fromkeys((line["scene"], line["renderer"]) for line in lines):
        these = [line for line in lines if (line["scene"], line["renderer"]) == (scene, renderer)]
        row = data["scenes"].setdefault(scene, {}).setdefault(renderer, {})
        wanted = ("rel_mse", "efficiency") if judged else ("mpaths_per_second", "device_bytes", "peak_rss_bytes")
        for key in wanted:
            values = [line[key] for line in these if key in line]
            if values:
                row[key] = [statistics.median(values), min(values), max(values)]


def _table(data: dict[str, Any]) -> str:
    lines = [
        "| scene | clrender, Mpaths/s | Mitsuba LLVM, Mpaths/s | speed ratio "
        "| relMSE: clrender, Mitsuba | efficiency ratio | device memory |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for scene in _ROWS:
        own, peer = (data["scenes"].get(scene, {}).get(name, {}) for name in ("clrender", "mitsuba"))
        errors = ", ".join(_value(each.get("rel_mse"), "{:.4f}") for each in (own, peer))
        efficiency = _ratio(own.get("efficiency"), peer.get("efficiency"))
        memory = _value([own["device_bytes"][0] / 1e6] if "device_bytes" in own else None, "{:,.1f} MB")
        lines.append(
            f"| {scene}: {SCENES[scene]} | {_value(own.get('mpaths_per_second'))} | "
            f"{_value(peer.get('mpaths_per_second'))} | "
            f"{_ratio(own.get('mpaths_per_second'), peer.get('mpaths_per_second'))} | "
            f"{errors if errors != f'{_NONE}, {_NONE}' else _NONE} | {efficiency} | {memory} |"
        )
    return "\n".join(lines)


def _value(numbers: list[float] | None, form: str = "{:.2f}") -> str:
    """A median with its range, if it has one."""
    if not numbers:
        return _NONE
    told = form.format(numbers[0])
    return told if len(numbers) == 1 else f"{told} ({form.format(numbers[1])}–{form.format(numbers[2])})"


def _ratio(own: list[float] | None, peer: list[float] | None) -> str:
    return f"**{own[0] / peer[0]:.2f}**" if own and peer else _NONE


def _growth(data: dict[str, Any]) -> str:
    """Plot of paths per second against triangles."""
    series = []
    for renderer, title, colour in (("clrender", "clrender", BLUE), ("mitsuba", "Mitsuba LLVM", ORANGE)):
        points = []
        for scene, triangles in _GROWTH.items():
            rows = data.get("growth", data)["scenes"].get(scene, {})
            numbers = rows.get(renderer, {}).get("mpaths_per_second")
            if numbers:
                points.append((float(triangles), numbers[0], min(numbers), max(numbers)))
        series.append(Series(title, points, colour))
    caption = "Million paths per second against triangles (S3)"
    return plot("growth", caption, ("triangles", "Mpaths/s"), series, (1e4, 1e5, 1e6, 4e6)).svg + "\n"


def _pictures() -> None:
    """Make docs/speed.jpg, the scenes side by side."""
    from doc_pictures import shown_linear, write_sheet

    import clrender
    from clrender.bench import write_scene

    pictures = []
    for name in ("S1", "S2", "S3-1M", "S4"):
        with tempfile.TemporaryDirectory() as folder:
            scene = clrender.load(str(write_scene(name, Path(folder))))
            pictures.append(shown_linear(clrender.render(scene, size=(240, 240), spp=256).linear))
    write_sheet("speed.jpg", [pictures])


if __name__ == "__main__":
    sys.exit(main())
