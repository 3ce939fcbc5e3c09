"""Many cases in one test: each is tried, and each that fails is told."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from cases import for_each


def test_all_are_tried_and_those_that_fail_are_told(tmp_path: Path) -> None:
    tried = []

    @for_each("a", [1, 2])
    @for_each(("b", "c"), [(3, "x"), (4, "y"), (5, "z")])
    def test(tmp_path: Path, a: int, b: int, c: str) -> None:
        tried.append((a, b, c))
        assert not list(tmp_path.iterdir())
        (tmp_path / "file").touch()
        if c == "x":
            raise KeyError(c)
        if a == 2 and c == "y":
            pytest.skip("not here")

    with pytest.raises(pytest.fail.Exception, match=r"^3 of 6 cases:(?s:.)*KeyError(?s:.)*KeyError(?s:.)*not here"):
        test(tmp_path=tmp_path)  # type: ignore[call-arg]
    assert tried == [(a, b, c) for a in (1, 2) for b, c in ((3, "x"), (4, "y"), (5, "z"))]


def test_no_case_at_all_is_a_fault() -> None:
    @for_each("a", [])
    def test(a: int) -> None: ...

    with pytest.raises(AssertionError, match="no case"):
        test()  # type: ignore[call-arg]


def test_a_patch_ends_with_its_case(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    @for_each("value", ["1", "2"])
    def test(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
        seen.append(os.environ.get("NO_SUCH_VARIABLE"))
        monkeypatch.setenv("NO_SUCH_VARIABLE", value)

    test(monkeypatch=monkeypatch)  # type: ignore[call-arg]
    assert seen == [None, None]
