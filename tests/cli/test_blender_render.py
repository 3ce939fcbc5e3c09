"""Scenes of Blender rendered by Cycles and by the add-on; needs a Python with Blender's module bpy."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from clrender.cli import main

CHECK = Path(__file__).resolve().parents[2] / "scripts" / "blender_check.py"


@pytest.mark.long
@pytest.mark.parametrize("scene", ["room", "outdoor", "objects"])
def test_cycles_and_the_addon_agree(scene: str, tmp_path: Path) -> None:
    python = os.environ.get("CLRENDER_BPY")
    if python is None:
        pytest.skip("CLRENDER_BPY names no Python with Blender's module bpy")
    archive, program = tmp_path / "addon.zip", tmp_path / "clrender"
    main(["blender", "-o", str(archive)], standalone_mode=False)
    # Blender's Python is another one, which would not find what this one has on its path
    paths = os.pathsep.join(path for path in sys.path if path)
    program.write_text(f'#!/bin/sh\nPYTHONPATH="{paths}" exec "{sys.executable}" -m clrender "$@"\n')
    program.chmod(0o755)
    command = [python, "-W", "ignore", str(CHECK), str(archive), "--program", str(program), "-o", str(tmp_path)]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ran = subprocess.run(
        [*command, "--scene", scene], capture_output=True, text=True, env=environment, timeout=600, check=False
    )
    report = json.loads(next(line for line in ran.stdout.splitlines() if line.startswith('{"scene"')))
    assert ran.returncode == 0, report
    assert abs(report["difference"]) < 0.02
