"""Fixtures of the statistical tests: where evidence goes, and renders on the device under test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from render_support import Studio
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.device import Device

__all__: list[str] = []


@pytest.fixture
def evidence(tmp_path: Path, request: pytest.FixtureRequest) -> Evidence:
    """Judge of this test's measurements; its statistics go into the report of ``--junitxml``."""

    def note(name: str, score: object) -> None:
        request.node.user_properties.append((name, score))

    return Evidence(tmp_path, request.node.nodeid.rpartition("/")[2], note)


@pytest.fixture(scope="session")
def studio(device: Device) -> Iterator[Studio]:
    """Renders on the device under test."""
    with clrender.Session(device.info.index) as session:
        yield Studio(session)
