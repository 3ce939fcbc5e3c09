"""Compiles programs before they are needed: one for any scene, or those of given scenes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from clrender.rendering.session import Session
from clrender.scene import load

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

__all__ = ["warm_up"]

_LAYER: Final = ("depth",)


def warm_up(
    devices: Sequence[Device],
    scenes: Mapping[str, Scene],
    should_stop: Callable[[], bool],
    tell: Callable[[str], None],
    **settings: Any,
) -> None:
    """Compile programs by rendering a few pixels on each device, so that drivers keep them for later processes.

    Parameters
    ----------
    devices : sequence of Device
    scenes : mapping of str to Scene
        Scenes, by their names in messages, whose own programs are compiled, as renders of many samples use them; if
        there are none, the programs for any scene are.
    should_stop : callable
        If it returns True, nothing more is compiled.
    tell : callable
        Called with one line of text for each program.
    **settings
        See `Session.render`; ``integrator``, for example.
    """
    kinds = [(scene, f"for {name}", "fast") for name, scene in scenes.items()]
    kinds = kinds or [(load("cornell"), "for any scene", "any")]
    for device in devices:
        with Session(device) as session:
            for scene, what, code in kinds:
                if should_stop():
                    return
                begin = time.perf_counter()
                session.render(scene, size=(16, 16), spp=1, code=code, aov=_LAYER, **settings)
                tell(f"compiled {what}, in {time.perf_counter() - begin:.1f} s: {device.info.title}")
