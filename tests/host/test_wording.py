"""Numbers in messages: digits in groups, no exponents, and the singular of one."""

from __future__ import annotations

import re
from pathlib import Path

from cases import for_each

import clrender
from clrender.wording import counted, grouped, rounded

ROOT = Path(clrender.__path__[0])


@for_each(
    "number, text", [(0, "0"), (1470, "1470"), (10_000, "10,000"), (58_880_000, "58,880,000"), (-12345, "-12,345")]
)
def test_whole_numbers(number: int, text: str) -> None:
    assert grouped(number) == text


@for_each("number, text", [
    (1, "1 sample"), (0, "0 samples"), (2, "2 samples"), (160_000_000, "160,000,000 samples"),
])  # fmt: skip
def test_what_is_counted(number: int, text: str) -> None:
    assert counted(number, "sample") == text


def test_a_plural_of_its_own() -> None:
    assert [counted(each, "vertex", "vertices") for each in (1, 2)] == ["1 vertex", "2 vertices"]


@for_each("number, text", [
    (1472.0, "1472"), (1471.6, "1472"), (58_880.4, "58,880"), (999.6, "1000"), (0.125, "0.125"), (23.456, "23.5"),
    (3.0, "3"), (0.0, "0"), (1e-6, "1e-06"), (99_999.7, "100,000"),
])  # fmt: skip
def test_other_numbers(number: float, text: str) -> None:
    assert rounded(number) == text


def test_nothing_is_counted_by_hand() -> None:
    """In messages of commands numbers of samples, images and so on come from `counted`."""
    plural = re.compile(r"\} (samples|images|frames|tiles|films|files|pixels|vertices|triangles|shapes)\b")
    size = re.compile(r"(x|×|x \{height|× \{height) ?\{[^{}]*\} pixels")
    found = [
        f"{path.name}: {line.strip()}"
        for path in sorted((ROOT / "cli").glob("*.py"))
        for line in path.read_text().splitlines()
        if plural.search(line) and "counted" not in line and "quantity" not in line and not size.search(line)
    ]
    allowed = {'f"{speed} samples/s on', "grouped(least)", "{JPEG_SIDE_LIMIT} pixels a side"}
    assert [line for line in found if not any(each in line for each in allowed)] == []
