"""The program that traces a render's samples: one that is there already, until the scene's own has been compiled."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from clrender import layout
from clrender.device.compilation import Compilation
from clrender.device.scene_arrays import scene_array_names
from clrender.device.small_code import FEW_RAYS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from clrender.device.compilation import Aside
    from clrender.device.device import Argument, Buffer, Device, Program
    from clrender.device.kernel_build import KernelBuild
    from clrender.integrators.descriptor import Pipeline

__all__ = ["TracingProgram", "compile_tracing"]

_COMPILED: Final[defaultdict[tuple[str, str], set[str]]] = defaultdict(set)
"""Macros that kernel files were compiled with in this process, by device and file."""


class TracingProgram:
    """The program of one render on one device, which may become a better one between two units.

    Compilers take seconds for a scene's own program, and any other would give the same bits. So a render begins with
    the best that is there. Where this is not the scene's own fast code, and that pays, it is compiled meanwhile.

    Parameters
    ----------
    device : Device
    pipeline : Pipeline
    own : KernelBuild
        How kernels are compiled for this scene and nothing else.
    universal : KernelBuild, optional
        How they are compiled for any scene; by default such a program is not used.
    samples : int or None
        About how many samples the device is to trace; see `Device.program`.

    Attributes
    ----------
    program : Program
    build : KernelBuild
        How it was compiled.
    waits : bool
        Whether `trace` returns only when the samples are there.
    """

    waits: Final = False

    def __init__(
        self, device: Device, pipeline: Pipeline, own: KernelBuild, universal: KernelBuild | None, samples: int | None
    ) -> None:
        self._device, self._pipeline, self._own = device, pipeline, own
        self._several = universal is not None and device.compiles_small_code
        self._samples = samples
        self._aside: Aside | None = None
        if universal is None or not self._several:
            self._take(own, device.program(pipeline.entry, own.tracing, samples))
            return
        entry = pipeline.entry
        self._fast = device.wants_fast(entry, own.tracing, samples)
        for build, small in ((own, False), (own, True), (universal, False), (universal, True)):
            if device.has_program(entry, build.tracing, small=small):
                break
        else:
            compiled = _COMPILED[device.info.title, entry]
            # Another scene than the one before: more may follow
            build, small = (universal, True) if compiled - {str(own.macros)} else (own, not self._fast)
            compiled.add(str(own.macros))
        self._take(build, self._built(build, small))
        self._is_best = build is own and not small

    def improve(self, rays: int) -> None:
        """Change to the scene's own fast code if it is worth while and there; if it is not, have it compiled.

        Parameters
        ----------
        rays : int
            Rays of this render so far.
        """
        many = rays > FEW_RAYS
        if not self._several:
            if self._samples and many and self._device.compiles_small_code:
                self._samples = None
                self._take(self._own, self._device.program(self._pipeline.entry, self._own.tracing))
            return
        if self._is_best or not (self._fast or many) or (self._aside is not None and not self._aside.ended):
            return
        own, entry = self._own, self._pipeline.entry
        if self._device.has_program(entry, own.tracing):
            self._take(own, self._built(own, small=False))
            self._is_best = True
        elif self._aside is not None:
            self._is_best = True  # it cannot be compiled there, nor probably here
        elif self._device.compile_aside is None or self._device.memory_limit is not None:
            if many:
                self._take(own, self._built(own, small=False))
                self._is_best = True
        else:
            kernels = [self._pipeline.kernel, *self._pipeline.then]
            records = bool(self._pipeline.record_bytes)
            self._aside = self._device.compile_aside(Compilation(entry, own.tracing, kernels, own.group, records))

    def _take(self, build: KernelBuild, program: Program) -> None:
        """Go on with a program; of fast code it is known from then on that the driver compiles it rightly."""
        prove = self._device.prove_fast if self._device.compiles_small_code else None
        if prove is not None and not program.is_small:
            prove("path")
        self.build, self.program = build, program

    def rows(self, slots: int, samples: int) -> int:
        """Rows of statistics of a launch with so many samples of so many slots: one for each work-item."""
        build = self.build
        return -(-slots // (build.lanes * build.packets * build.group)) * build.group

    def trace(
        self,
        scene: Sequence[Argument],
        span: Sequence[np.uint32],
        samples: Buffer,
        stats: Buffer,
        more: Sequence[Argument],
    ) -> None:
        """Enqueue the tracing of a launch's samples.

        Parameters
        ----------
        scene : sequence
            Arguments of kernels that read the scene.
        span : sequence of numpy.uint32
            First slot, slots, first sample, samples of each.
        samples, stats : Buffer
            Where results go, and the statistics of each of `rows`.
        more : sequence
            Arguments of what the integrator has prepared.
        """
        items = self.rows(int(span[1]), int(span[3]))
        for kernel in (self._pipeline.kernel, *self._pipeline.then):
            arguments = [*scene, *span, samples, stats, *more]
            self._device.launch(self.program, kernel, items, self.build.group, arguments)

    def _built(self, build: KernelBuild, small: bool) -> Program:
        return self._device.program(self._pipeline.entry, build.tracing, 0 if small else None)


def compile_tracing(device: Device, compilation: Compilation) -> None:
    """Compile the kernels of a tracing program by launches that trace nothing.

    Drivers compile for a size of groups at the first launch.

    Raises
    ------
    RenderError, DeviceError
        When the compiler rejects the program, or the driver fails.
    """
    program = device.program(compilation.entry, compilation.macros)
    settings: Any = np.zeros(1, layout.dtype("Settings"))
    settings["width"] = settings["height"] = settings["tile"] = 4
    none = device.upload(np.zeros(64, np.uint32))
    buffers: dict[str, Argument] = {"settings": device.upload(settings)}
    scene: list[Argument] = [buffers.get(name, none) for name in scene_array_names()]
    stats = device.empty(16 * compilation.group)
    arguments = [*scene, *[np.uint32(0)] * 4, none, stats, *([none] if compilation.records else [])]
    for kernel in compilation.kernels:
        device.launch(program, kernel, compilation.group, compilation.group, arguments)
    device.finish()
