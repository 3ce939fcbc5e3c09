"""Small USD stages for tests, read in this process: to start another for each would take most of a test's time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

import clrender
import clrender.importers.usd.read
from clrender.errors import SceneError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.usd.process import Stage
from clrender.scene import Scene

__all__ = ["BOUND", "QUAD", "Load", "light_of", "load_stage", "mesh", "refusal", "shape_of", "surface", "textured"]

Load = Callable[..., Scene]
BOUND = "rel material:binding = </M>"

QUAD = "(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)"


def mesh(
    more: str = "",
    *,
    name: str = "m",
    counts: Sequence[int] = (4,),
    indices: Sequence[int] = (0, 1, 2, 3),
    points: str = QUAD,
    scheme: str = "none",
) -> str:
    """A mesh; `more` is what else it has."""
    return f"""
def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"])
{{
    int[] faceVertexCounts = {list(counts)}
    int[] faceVertexIndices = {list(indices)}
    point3f[] points = [{points}]
    uniform token subdivisionScheme = "{scheme}"
    {more}
}}
"""


def surface(inputs: str, more: str = "") -> str:
    """A material `/M` with a UsdPreviewSurface; `more` is its other nodes."""
    return f"""
def Material "M"
{{
    token outputs:surface.connect = </M/S.outputs:surface>
    def Shader "S"
    {{
        uniform token info:id = "UsdPreviewSurface"
        {inputs}
        token outputs:surface
    }}
    {more}
}}
"""


@pytest.fixture
def load_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Scene]:
    """Loads a stage from its text: of metres and +y up, unless `head` says otherwise."""
    from clrender.importers.usd.extraction import extracted

    def in_this_process(path: Path, files: AssetFiles, time_at: float | None, offsets: Sequence[float]) -> Stage:
        arrays: list[Any] = []
        allowed = [str(each) for each in files.allow_paths]
        request = {"source": files.source, "path": str(path), "allowed": allowed}
        tables = extracted({**request, "time_at": time_at, "offsets": list(offsets)}, arrays)
        return Stage(tables, {str(number): array for number, array in enumerate(arrays)})

    monkeypatch.setattr(sys.modules["clrender.importers.usd.read"], "read_stage", in_this_process)
    count = iter(range(10**6))

    def load(text: str, *, head: str = 'metersPerUnit = 1\nupAxis = "Y"', name: str = "", **choices: Any) -> Scene:
        # USD keeps layers by their names, so that each has its own
        path = tmp_path / (name or f"stage{next(count)}.usda")
        # Statements end with lines
        text = text.replace(" }", "\n}")
        path.write_text(f"#usda 1.0\n(\n{head}\n)\n{text}")
        return clrender.load(path, **choices)

    return load


def refusal(call: Callable[[], Any]) -> str:
    """The message of the error that a call raises."""
    with pytest.raises(SceneError) as error:
        call()
    return str(error.value)


def shape_of(scene: Scene, number: int = 0) -> Any:
    """One of its shapes, of a type that the test knows."""
    return scene.shapes[number]


def light_of(scene: Scene, number: int = 0) -> Any:
    """One of its lights."""
    return scene.lights[number]


def textured(more: str = "", output: str = "rgb", wanted: str = "color3f inputs:diffuseColor") -> str:
    nodes = f"""
def Shader "T"
{{
    uniform token info:id = "UsdUVTexture"
    asset inputs:file = @a.png@
    float2 inputs:st.connect = </M/R.outputs:result>
    float3 outputs:rgb
    float outputs:r
    float outputs:g
    float outputs:b
    float outputs:a
    {more}
}}
def Shader "R"
{{
    uniform token info:id = "UsdPrimvarReader_float2"
    string inputs:varname = "st"
    float2 outputs:result
}}
"""
    return surface(f"{wanted}.connect = </M/T.outputs:{output}>", nodes)
