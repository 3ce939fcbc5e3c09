"""A notebook as people run it: executed without a front end, spoken to as one would, and exported as HTML."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import os
import re
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from view_browser import FAILURES, SCENE, chromium
from view_clients import Received

import clrender

nbformat = pytest.importorskip("nbformat", reason="the extra for notebooks is not installed")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
nbconvert = pytest.importorskip("nbconvert", reason="nbconvert is not installed")
pytest.importorskip("ipykernel", reason="ipykernel is not installed")
pytest.importorskip("anywidget", reason="the extra for notebooks is not installed")

# Jupyter's own warnings, on how it finds its folders and its event loops, are not this package's.
pytestmark = [pytest.mark.filterwarnings("default"), pytest.mark.usefixtures("only_driver")]

WIDGET = "application/vnd.jupyter.widget-view+json"
STATE = "application/vnd.jupyter.widget-state+json"
CELLS = (
    """
import clrender
import clrender.view.notebook
from clrender.drivers import select
(device,) = select("{device}")
before = device.buffers
scene = clrender.load("scene.toml")
view = clrender.View(scene, device=device, size=(96, 54), spp=8)
""",
    "view",
    "finished = view.wait(120)\nfinished.stats['image_sha256']",
    "view",
    """
plot = clrender.ConvergencePlot(live=True)
with clrender.Session(device) as session:
    image = session.render(scene, size=(96, 54), spp=64, replicate_spp=8, aov=("normal", "object"), on_progress=plot)
""",
    "image",
    "plot",
)


@dataclass
class Kernel:
    """A kernel, the notebook it executes, and the front end's side of its messages."""

    client: Any

    async def run(self, source: str) -> Any:
        """A cell more; its outputs."""
        cell = nbformat.v4.new_code_cell(source)
        self.client.nb.cells.append(cell)
        await self.client.async_execute_cell(cell, len(self.client.nb.cells) - 1)
        return cell.outputs

    def say(self, model: str, content: dict[str, Any]) -> None:
        """A custom message of a widget, as a page sends it."""
        told = {"comm_id": model, "data": {"method": "custom", "content": content}}
        channel = self.client.kc.shell_channel
        channel.send(self.client.kc.session.msg("comm_msg", told))

    async def next(self, kind: str, wanted: Callable[[dict[str, Any]], bool] = lambda content: True) -> dict[str, Any]:
        """The next message of the kernel of a kind of which something holds."""
        while True:
            message: dict[str, Any] = await self.client.kc.get_iopub_msg(timeout=120)
            if message["msg_type"] == kind and wanted(message["content"]):
                return message

    async def received(self, model: str, display: str, *wanted: Callable[[Received], bool]) -> list[Received]:
        """Of each of some things that may hold of a message of the engine to an output, the first of which it does.

        They may come in any order. Frames are acknowledged on the way.
        """
        found: dict[int, Received] = {}
        while len(found) < len(wanted):
            message = await self.next("comm_msg", lambda c: c["comm_id"] == model and c["data"]["method"] == "custom")
            content = message["content"]["data"]["content"]
            if content["display"] != display or "ended" in content:
                continue
            got = Received.of(content["text"] if "text" in content else bytes(message["buffers"][0]))
            if got.kind == "frame":
                ack = {"type": "ack", "frame": got.content["frame"]}
                self.say(model, {"display": display, "text": json.dumps(ack)})
            for number, holds in enumerate(wanted):
                if number not in found and holds(got):
                    found[number] = got
        return [found[number] for number in range(len(wanted))]


@pytest.fixture(scope="module")
def execute(tmp_path_factory: pytest.TempPathFactory, cache_folder: Path) -> Iterator[Callable[..., Any]]:
    """Executes cells in a kernel that begins in a folder of its own, and goes on as told; gives notebook and folder."""
    own = tmp_path_factory.mktemp("jupyter")
    device = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")

    def run(cells: tuple[str, ...], talk: Callable[[Kernel], Awaitable[None]]) -> tuple[Any, Path]:
        notebook, folder = nbformat.v4.new_notebook(), tmp_path_factory.mktemp("notebook")
        (folder / "scene.toml").write_text(SCENE)

        async def whole() -> None:
            client = nbclient.NotebookClient(
                notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
            )
            client.reset_execution_trackers()
            async with client.async_setup_kernel():
                kernel = Kernel(client)
                for source in cells:
                    await kernel.run(source.replace("{device}", device).strip())
                await talk(kernel)
            client.set_widgets_metadata()

        asyncio.run(whole())
        return notebook, folder

    with pytest.MonkeyPatch.context() as patch:
        for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR", "MPLCONFIGDIR"):
            patch.setenv(name, str(own / name))
        patch.setenv("PYTHONPATH", str(Path(clrender.__path__[0]).parent))
        patch.setenv("PYDEVD_DISABLE_FILE_VALIDATION", "1")
        yield run


def stills(outputs: Any) -> list[str]:
    """HTML of the pictures that stand below views."""
    found = [output.data.get("text/html", "") for output in outputs if "data" in output]
    return [html for html in found if "data-clrender-still" in html]


def picture(html: str) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """The first picture of HTML."""
    found = re.search(r'src="data:image/jpeg;base64,([^"]+)"', html)
    assert found, html[:500]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(found[1]))).convert("RGB"))


async def _talk(kernel: Kernel) -> None:
    cells = kernel.client.nb.cells
    model = cells[1].outputs[0].data[WIDGET]["model_id"]
    state = kernel.client.widget_state[model]
    assert state["_model_module"] == "anywidget"
    assert "function mount(" in state["_esm"] and ".cv" in state["_css"]
    assert state["still"] in stills(cells[1].outputs)[0]
    assert cells[3].outputs[0].data[WIDGET]["model_id"] == model  # another display of the same

    # An output begins, and is told how things stand; another one comes.
    def is_hello(m: Received) -> bool:
        return m.kind == "hello"

    def is_final(m: Received) -> bool:
        return m.kind == "frame" and bool(m.content["final"])

    kernel.say(model, {"display": "first"})
    got, shown = await kernel.received(model, "first", is_hello, is_final)
    assert got.content["protocol"] == 1
    assert shown.pixels.shape == (54, 96, 3)
    kernel.say(model, {"display": "second"})
    _, other = await kernel.received(model, "second", is_hello, is_final)
    np.testing.assert_array_equal(other.pixels, shown.pixels)

    # The camera moves: the first output is not read any more, and the second has its frames all the same.
    move = {"type": "camera", "id": 5, "camera": {"position": [0.5, 2.0, 4.0]}}
    kernel.say(model, {"display": "second", "text": json.dumps(move)})
    before = shown.content["revision"]
    moved, done = await kernel.received(
        model,
        "second",
        lambda m: m.kind == "frame" and m.content["answers"] == 5,
        lambda m: m.kind == "progress" and m.content["revision"] > before and bool(m.content["sha256"]),
    )
    assert moved.content["revision"] > before
    outputs = await kernel.run("list(view.scene.camera.position)")
    assert outputs[0].data["text/plain"] == "[0.5, 2.0, 4.0]"
    again = await kernel.run("clrender.render(view.scene, device=device, size=(96, 54), spp=8).stats['image_sha256']")
    assert again[0].data["text/plain"] == repr(done.content["sha256"])
    kernel.say(model, {"display": "second", "text": '{"type": "nonsense"}'})
    await kernel.received(model, "second", lambda m: m.kind == "refused")

    # Its end: the widget goes, the pictures show what was seen last, and the device is as it was.
    outputs = await kernel.run("view.close(); view.close()\n(device.buffers == before, view)")
    assert outputs[-1].data["text/plain"].startswith("(True, <clrender.View of A ball on a table, 96 x 54, closed>")
    outputs = await kernel.run("view")
    assert len(outputs) == 1 and WIDGET not in outputs[0].data


@pytest.fixture(scope="module")
def executed(execute: Callable[..., Any]) -> tuple[Any, Path]:
    """A notebook that was executed and spoken to, and the HTML it was exported to."""
    notebook, folder = execute(CELLS, _talk)
    html, _ = nbconvert.HTMLExporter().from_notebook_node(notebook)
    (folder / "notebook.html").write_text(html, encoding="utf-8")
    return notebook, folder / "notebook.html"


@pytest.mark.long
def test_a_notebook_is_executed_spoken_to_and_exported(executed: tuple[Any, Path]) -> None:
    notebook, exported = executed
    first, last = (picture(stills(cell.outputs)[0]) for cell in (notebook.cells[1], notebook.cells[-1]))
    assert first.shape == (54, 96, 3)
    np.testing.assert_array_equal(first, last)  # brought up to date when the view ended
    finished = notebook.cells[5].outputs[0].data["text/html"]
    assert np.abs(picture(finished).astype(int) - last).mean() > 3.0  # the camera was elsewhere
    assert finished.count("<input") == 3
    for drawn in (notebook.cells[at].outputs[0].data["text/html"] for at in (4, 6)):
        assert "<svg" in drawn and "relative error (RMS)" in drawn
    assert notebook.metadata.widgets[STATE]["state"]
    html = exported.read_text(encoding="utf-8")
    assert html.count("data-clrender-still") >= 3
    np.testing.assert_array_equal(picture(html[html.index("data-clrender-still") :]), last)


@pytest.mark.long
def test_what_is_exported_is_seen_without_a_network(executed: tuple[Any, Path]) -> None:
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1000, "height": 900})
        page.route(re.compile("^https?:"), lambda route: route.abort())
        page.goto(executed[1].as_uri())
        try:
            still = page.locator("[data-clrender-still] img").first
            assert still.is_visible() and still.evaluate("image => image.naturalWidth") == 96
            page.locator("label", has_text="object").click()
            assert page.locator("figure img[alt=object]").is_visible()
            assert not page.locator("figure img[alt=normal]").is_visible()
        finally:
            FAILURES.mkdir(exist_ok=True)
            page.screenshot(path=FAILURES / "notebook.png", full_page=True)


@pytest.mark.long
def test_the_example_of_the_documentation_runs(execute: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    example = nbformat.read(Path(__file__).parents[2] / "docs" / "notebook.ipynb", 4)
    smaller = {"(640, 360)": "(48, 27)", "(320, 180)": "(48, 27)", "spp=64": "spp=4", "spp=256": "spp=64"}
    cells = []
    for cell in example.cells:
        source = cell.source
        for large, small in smaller.items():
            source = source.replace(large, small)
        if cell.cell_type == "code":
            cells.append(source)

    async def talk(kernel: Kernel) -> None:
        outputs = await kernel.run("image.stats['samples'], better.stats['samples'], plot.points[-1].samples, view")
        assert outputs[0].data["text/plain"].startswith(f"({48 * 27 * 64}, {48 * 27 * 64}, 64.0, <clrender.View")
        assert "closed" in outputs[0].data["text/plain"]

    monkeypatch.setenv("CLRENDER_DEVICE", os.environ.get("CLRENDER_TEST_DEVICE", "pocl"))
    notebook, _ = execute(tuple(cells), talk)
    alone, compared = (cell.outputs[-1].data["text/html"] for cell in notebook.cells[-3:-1])
    assert "<svg" in alone and all(f">{name}</text>" in compared for name in ("path", "bdpt", "photon"))


@pytest.mark.long
def test_a_view_that_no_output_shows_any_more_ends(execute: Callable[..., Any]) -> None:
    async def talk(kernel: Kernel) -> None:
        model = kernel.client.nb.cells[1].outputs[0].data[WIDGET]["model_id"]
        await kernel.run("clrender.view.notebook._UNWATCHED_SECONDS = 0.3")
        for name in ("first", "second"):
            kernel.say(model, {"display": name})
            await kernel.received(model, name, lambda m: m.kind == "hello")
        kernel.say(model, {"display": "first", "leaves": True})
        kernel.say(model, {"display": "nobody", "leaves": True})
        outputs = await kernel.run("import time; time.sleep(1.5)\nview")
        assert WIDGET in outputs[0].data
        kernel.say(model, {"display": "second", "leaves": True})
        await kernel.next("comm_close", lambda content: content["comm_id"] == model)
        outputs = await kernel.run("(device.buffers == before, view._closed, view.image is not None)")
        assert outputs[0].data["text/plain"] == "(True, True, True)"

    execute(CELLS[:2], talk)


@pytest.mark.long
def test_what_is_wrong_is_one_sentence_and_leaves_nothing_behind(execute: Callable[..., Any]) -> None:
    wrong = """
import threading
said = []
for arguments in ({"spp": 0}, {"size": 3}, {"outputs": ["a.xyz"]}, {"device": "nobody's"}):
    try:
        clrender.View(scene, **{"device": device, **arguments})
    except clrender.ClrenderError as error:
        said.append(str(error))
(len(said), [t.name for t in threading.enumerate() if "clrender" in t.name], device.buffers == before, said)
"""

    async def talk(kernel: Kernel) -> None:
        outputs = await kernel.run(wrong)
        assert outputs[0].data["text/plain"].replace("\n", "").startswith("(4, [], True,"), outputs[0].data[
            "text/plain"
        ]

    execute((CELLS[0].replace("view = ", "# "),), talk)


@pytest.mark.long
def test_a_kernel_that_ends_ends_its_views(execute: Callable[..., Any]) -> None:
    async def talk(kernel: Kernel) -> None:
        await kernel.run(
            "import atexit, pathlib\n"
            "end = view._engine.close\n"
            "view._engine.close = lambda: (end(), pathlib.Path('ended').write_text(str(device.buffers == before)))"
        )

    _, folder = execute((CELLS[0], "view"), talk)
    assert (folder / "ended").read_text() == "True"
