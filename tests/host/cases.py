"""Many small cases in one test: all are tried, and those that fail are told together."""

from __future__ import annotations

import functools
import inspect
import re
import traceback
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeVar

import pytest

__all__ = ["for_each"]

MOST = 20
"""Failed cases that are told in full."""

Test = TypeVar("Test", bound=Callable[..., None])


def for_each(names: str | tuple[str, ...], values: Iterable[Any]) -> Callable[[Test], Test]:
    """As `pytest.mark.parametrize`, but in one test that tries every value, whatever fails before it.

    For cases so small that a test of its own costs more than what it checks. Several make the product. Each case has a
    folder of its own in `tmp_path`, and what it does with `monkeypatch` ends with it; other fixtures are shared.

    Parameters
    ----------
    names : str or tuple
        Of the arguments; in a text, with commas between them.
    values : iterable
        A value, or a tuple of one for each name.
    """
    single = isinstance(names, str) and "," not in names
    arguments = re.findall(r"\w+", names) if isinstance(names, str) else list(names)
    rows = list(values)

    def decorate(test: Test) -> Test:
        signature = inspect.signature(test)
        inner: Callable[..., None] = getattr(test, "one_case", test)
        more: list[dict[str, Any]] = getattr(test, "all_cases", [{}])
        given = [dict(zip(arguments, [row] if single else row, strict=True)) for row in rows]
        cases = [{**first, **second} for first in given for second in more]

        @functools.wraps(inner)
        def tried(*args: Any, **fixtures: Any) -> None:
            failed = [
                told for number, case in enumerate(cases) if (told := _fault(inner, number, case, args, fixtures))
            ]
            assert cases, "there is no case"
            if failed:
                pytest.fail("\n".join([f"{len(failed)} of {len(cases)} cases:", *failed[:MOST]]), pytrace=False)

        kept = [parameter for name, parameter in signature.parameters.items() if name not in arguments]
        assert len(kept) == len(signature.parameters) - len(arguments), "the test takes no such argument"
        vars(tried).update(one_case=inner, all_cases=cases, __signature__=signature.replace(parameters=kept))
        return tried  # type: ignore[return-value]

    return decorate


def _fault(
    test: Callable[..., None], number: int, case: dict[str, Any], args: tuple[Any, ...], fixtures: dict[str, Any]
) -> str | None:
    """What is wrong in one case. One that is left out would be as good as none, so that is a fault as well."""
    own = dict(fixtures)
    try:
        with ExitStack() as stack:
            if isinstance(folder := own.get("tmp_path"), Path):
                own["tmp_path"] = folder / str(number)
                own["tmp_path"].mkdir()
            if isinstance(patch := own.get("monkeypatch"), pytest.MonkeyPatch):
                own["monkeypatch"] = stack.enter_context(patch.context())
            test(*args, **own, **case)
    except (Exception, pytest.fail.Exception, pytest.skip.Exception):
        return f"--- {case}\n{traceback.format_exc()}"
    return None
