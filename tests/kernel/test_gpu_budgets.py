"""Registers, spills and scratch memory of kernels on GPUs that are not there: no program takes more than its budget."""

from __future__ import annotations

import dataclasses

import gpu_static
import pytest
from gpu_static import BUDGETS, PROGRAMS, TARGETS, MissingCompiler, Usage, budgets, measure, over_budget

TIERS = ("simple", "materials")
"""What the next feature is likely to make larger, compiled in seconds; all others take minutes."""


def usages(programs: tuple[str, ...], targets: tuple[str, ...]) -> list[Usage]:
    try:
        return [measure(program, target) for program in programs for target in targets]
    except MissingCompiler as missing:
        pytest.skip(str(missing))


@pytest.mark.slow
def test_the_tiers_keep_within_their_budgets() -> None:
    found = usages(TIERS, ("sm_90", "gfx1100"))
    assert list(over_budget(found, budgets())) == []


@pytest.mark.slow
def test_every_program_keeps_within_its_budget() -> None:
    found = usages(tuple(PROGRAMS), tuple(TARGETS))
    assert list(over_budget(found, budgets())) == []


def test_every_program_and_target_has_a_budget() -> None:
    assert {(each.program, each.target) for each in budgets()} == {(a, b) for a in PROGRAMS for b in TARGETS}


def test_what_is_over_its_budget_is_named() -> None:
    one = budgets()[0]
    more = dataclasses.replace(one, registers=one.registers + 1, spill_bytes=one.spill_bytes + 4)
    assert list(over_budget([one], budgets())) == []
    assert list(over_budget([more], budgets())) == [
        f"{one.program} on {one.target}: registers is {more.registers}, and {one.registers} is the most",
        f"{one.program} on {one.target}: spill_bytes is {more.spill_bytes}, and {one.spill_bytes} is the most",
    ]
    assert list(over_budget([one], [])) == [f"{one.program} on {one.target}: no budget in {BUDGETS.name}"]


def test_the_page_shows_the_budgets() -> None:
    assert gpu_static.PAGE.read_text() == gpu_static.page_with(budgets())


def test_programs_are_those_of_the_kernels() -> None:
    """Every entry point but those of the probe, the furnace, formulas and recorded paths, which are of no render."""
    folder = BUDGETS.parents[1] / "kernels"
    entries = {path.relative_to(folder).as_posix() for path in folder.rglob("*.cl")}
    assert entries - {program.entry for program in PROGRAMS.values()} == {
        "common.cl",
        "probe/arithmetic.cl",
        "material/furnace.cl",
        "plugin/formula.cl",
        *(f"integrator/inspect_{name}.cl" for name in ("path", "guided", "whitted", "bdpt")),
    }
