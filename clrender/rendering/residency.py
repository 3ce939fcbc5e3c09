"""What stays on devices from one render to the next: programs, uploaded scenes and scratch memory."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.device import Buffer, Device
from clrender.device.formulas import said_by
from clrender.device.launch import LaunchConfig, Scratch
from clrender.device.preparation import DevicePreparation
from clrender.device.prepared import Prepared
from clrender.device.scene_arrays import SceneArrays
from clrender.device.worker import DeviceWorker
from clrender.drivers import select
from clrender.errors import DeviceError, UsageError
from clrender.flatten.flat_scene import FlatScene, flatten, scene_origin, seen_by, view_of
from clrender.flatten.light_groups import lit_by
from clrender.flatten.plugin_lights import Emitted, measured_lights
from clrender.flatten.plugin_rows import used_plugins
from clrender.flatten.touching import KnownMoves, camera_reach
from clrender.integrators.descriptor import Pipeline
from clrender.process.stages import Stages
from clrender.rendering.job import RenderJob
from clrender.scene.light_kinds import PluginLight

if TYPE_CHECKING:
    from clrender.plugins import Plugin
    from clrender.scene import Scene

__all__ = ["ApartError", "Residency"]


class Residency:
    """Open devices, and what one render leaves on them for the next.

    It is used by one thread at a time; `Session` sees to that.

    Parameters
    ----------
    given : sequence of str, int and Device
        Devices that are open, and descriptions of others; empty for the best device that works.
    stages : Stages
        What is being done, for those who wait.
    tell : callable
        Called with one line of text for the user.
    reports_compiling : bool
        Whether the devices report what they compile to `stages`.
    refits : bool
        Whether the BVH of a scene whose vertices and instances have moved is refitted instead of built.

    Attributes
    ----------
    guided : (str, Prepared) or None
        The hash of the last guided job, and what was trained for it.
    """

    def __init__(
        self,
        given: Sequence[str | int | Device],
        stages: Stages,
        tell: Callable[[str], None],
        reports_compiling: bool,
        refits: bool = False,
    ) -> None:
        self.stages, self.tell = stages, tell
        self.borrowed = [each for each in given if isinstance(each, Device)]
        self._named = [each for each in given if not isinstance(each, Device)]
        self._reports, self.refits = reports_compiling, refits
        self._closed = False
        self.guided: tuple[str, Prepared] | None = None
        self._devices: list[Device] | None = None
        self._dismissed: set[Device] = set()
        self._flat: tuple[_Geometry, FlatScene] | None = None
        self._known = KnownMoves()
        self._given: dict[tuple[Any, ...], Emitted] = {}
        self._uploaded: dict[Device, tuple[FlatScene, SceneArrays]] = {}
        self._scratch: dict[Device, Scratch] = {}

    @property
    def opened(self) -> bool:
        """Whether the devices have been opened."""
        return self._devices is not None

    @property
    def devices(self) -> list[Device]:
        """The devices that are usable, opened at the first access.

        Raises
        ------
        UsageError, DeviceError
            No device matches the description, or none works.
        """
        if self._closed:
            raise UsageError("the session is closed; open another")
        if self._devices is None:
            self._devices = self._open()
        usable = [device for device in self._devices if not (device.lost or device in self._dismissed)]
        if not usable:
            raise DeviceError("every device of the session hangs or computes wrong results; open another session")
        return usable

    def _open(self) -> list[Device]:
        with self.stages.during("opening"):
            opened = select(self._named, notify=self.tell) if self._named or not self.borrowed else []
        devices = [*self.borrowed, *opened]
        if self.refits and len(devices) > 1:
            raise UsageError(
                f"refit is for one device, and there are {len(devices)}: their BVHs would differ, and so would "
                "the last digits of their results; name one, or leave it out"
            )
        if self._reports:
            for device in opened:
                device.on_compile = self.stages.compiling
        return devices

    @contextmanager
    def in_turn(self) -> Iterator[None]:
        """Context in which devices that others may share work for this session; it has their turns."""
        with ExitStack() as ended:
            for device in self.borrowed:
                ended.enter_context(device.owned_by(self))
                if self._reports:
                    ended.callback(setattr, device, "on_compile", device.on_compile)
                    device.on_compile = self.stages.compiling
            yield

    def close(self) -> None:
        """Release everything on the devices, and close those that were opened here."""
        self._closed = True
        for device in self._devices or []:
            self._release_all(device)
            if device not in self.borrowed:
                device.close()
        self._uploaded, self._scratch, self._flat, self._devices = {}, {}, None, None

    def has_read(self, scene: Scene) -> bool:
        """Whether all files of a scene have been read, as only its camera differs from the last one."""
        return self._flat is not None and self._flat[0].scene.shares_contents(scene)

    def flat(self, job: RenderJob) -> FlatScene:
        """The job's scene as arrays. If only the camera differs from the last job, its arrays are reused."""
        geometry = _Geometry.of(job)
        if self._flat is None or not self._flat[0].same(geometry, self._flat[1].camera_free):
            with self.stages.during("flattening"):
                emitted = self._emitted(job.scene)
                self._flat = geometry, _flattened(job, self._known, emitted)
        settings = job.settings
        flat = seen_by(self._flat[1], job.scene, settings.width, settings.height)
        return self._seen_together(flat, job) if job.views else flat

    def _emitted(self, scene: Scene) -> Mapping[int, Emitted] | None:
        """What lights of plugins give: their formulas are evaluated on the first device, as any other would."""
        if not any(isinstance(light, PluginLight) for light in scene.lights):
            return None
        return measured_lights(scene, partial(said_by, self.devices[0]), self._given)

    def _seen_together(self, flat: FlatScene, job: RenderJob) -> FlatScene:
        """The arrays with all cameras of a batch.

        Raises
        ------
        ApartError
            A camera needs other arrays, or is in other media.
        """
        assert self._flat is not None
        geometry, settings, views = self._flat[0], job.settings, []
        for camera in job.views:
            scene = job.scene.with_checked(camera=camera)
            if not geometry.same(geometry.seen_by(scene), self._flat[1].camera_free):
                raise ApartError
            views.append(view_of(self._flat[1], scene, settings.width, settings.height))
        cameras = np.concatenate([row for row, _ in views])
        moving = cameras["segments"] > 0
        counts = np.where(moving, cameras["segments"] + 1, 0)
        cameras["first_knot"] = np.cumsum(counts) - counts
        knots = [some for (_, some), moves in zip(views, moving.tolist(), strict=True) if moves]
        if not knots:
            knots = [flat.camera_knots]
        media = cameras[["interior_first", "interior_last", "cuts_media"]]
        if (media != media[0]).any() or cameras["cuts_media"].any():
            raise ApartError
        features = flat.features.seen_by(cameras, flat.moves)
        return dataclasses.replace(flat, camera=cameras, camera_knots=np.concatenate(knots), features=features)

    def worker(
        self,
        device: Device,
        flat: FlatScene,
        settings: npt.NDArray[np.void],
        pipeline: Pipeline,
        launch: LaunchConfig,
        on_device: Callable[[DeviceWorker], DevicePreparation] | None = None,
    ) -> DeviceWorker:
        """Make a worker for a scene on a device, and upload the scene if needed; one worker per device at a time.

        Parameters
        ----------
        device : Device
        flat : FlatScene
        settings : (1,) `Settings`
            See `clrender.settings.RenderSettings.struct`.
        pipeline : Pipeline
            The kernels of an integrator.
        launch : LaunchConfig
            How the work is divided into launches.
        on_device : callable, optional
            Called with the worker; prepares what its integrator needs on the device.
        """
        begin, before = time.perf_counter(), device.buffers
        with ExitStack() as failed:
            failed.callback(self._forget, device, before)
            held, arrays = self._uploaded.get(device, (None, None))
            if held is not None and arrays is not None and held.arrays is flat.arrays:
                arrays.look(flat)
            else:
                arrays = self._moved(device, arrays, flat)
            self._uploaded[device] = flat, arrays
            built = time.perf_counter() - begin
            scratch = self._scratch.setdefault(device, Scratch(device))
            worker = DeviceWorker(device, flat, settings, pipeline, launch, on_device, arrays=arrays, scratch=scratch)
            worker.build_seconds += built
            failed.pop_all()
        return worker

    def _moved(self, device: Device, arrays: SceneArrays | None, flat: FlatScene) -> SceneArrays:
        """The arrays of another scene: those that are there, if they can be refitted; else they are released."""
        apart = trees = None
        lent: dict[str, Buffer] = {}
        rates: dict[tuple[str, bytes], float] = {}
        if arrays is not None:
            del self._uploaded[device]
            rates = arrays.rates_for(flat)
            with ExitStack() as spent:
                spent.callback(arrays.release)
                if self.refits and arrays.refit(flat):
                    spent.pop_all()
                    return arrays
                apart = arrays.apart if self.refits and len(arrays.apart) == len(flat.arrays["shapes"]) else None
                trees = arrays.trees_for(flat)
                lent = arrays.lent_to(flat)
        with self.stages.during("building"), ExitStack() as spent, ExitStack() as failed:
            if trees is not None:
                spent.callback(trees.release)
            for buffer in lent.values():
                failed.callback(device.release, buffer)
            made = SceneArrays(device, flat, apart=apart, earlier=trees, lent=lent)
            made.rates = rates
            failed.pop_all()
            return made

    def _forget(self, device: Device, before: frozenset[Buffer]) -> None:
        """Release everything that was allocated on a device since `before`, after a worker could not be made."""
        self._lose(device)
        device.release_but(before)

    def _lose(self, device: Device) -> None:
        """Note that nothing of this session is on a device any more."""
        self._uploaded.pop(device, None)
        self._scratch.pop(device, None)

    def restart(self, device: Device) -> None:
        """Reset a device that failed, so that it can be tried again: everything on it is released."""
        self._lose(device)
        self._release_all(device)
        if device not in self.borrowed:
            device.reopen()

    def _release_all(self, device: Device) -> None:
        """Release what is here on a device. Other sessions may have theirs on one that was lent."""
        if device in self.borrowed:
            device.release_of(self)
        else:
            device.release_but(())

    def dismiss(self, device: Device) -> None:
        """Exclude a device from now on, because it hangs or its results are wrong."""
        self._dismissed.add(device)


class ApartError(Exception):
    """Cameras of a batch cannot be rendered together."""


@dataclass(frozen=True)
class _Geometry:
    """Everything that determines the arrays of a scene, except the camera."""

    scene: Scene
    light_sampler: str
    compensated: bool
    termination: float | None
    lit_by: str | None
    plugins: tuple[Plugin, ...]
    origin: tuple[float, float, float]
    reach: float
    interval: tuple[float, float] | None

    @classmethod
    def of(cls, job: RenderJob) -> _Geometry:
        sampling = _light_sampler(job), _compensated(job), job.settings.termination, job.lit_by
        return cls(job.scene, *sampling, used_plugins(job.scene), *_view(job.scene))

    def seen_by(self, scene: Scene) -> _Geometry:
        """The same with the camera of another scene, which has the same contents."""
        origin, reach, interval = _view(scene)
        return dataclasses.replace(self, scene=scene, origin=origin, reach=reach, interval=interval)

    def same(self, other: _Geometry, camera_free: float) -> bool:
        """Whether the arrays are the same, which up to a reach do not depend on it."""
        a, b = self.scene, other.scene
        if self.reach != other.reach and max(self.reach, other.reach) > camera_free:
            return False
        if dataclasses.replace(self, scene=b, reach=other.reach) != other:  # all but the scene
            return False
        return a.shares_contents(b) or a.content_sha256() == b.content_sha256()


def _view(scene: Scene) -> tuple[tuple[float, float, float], float, tuple[float, float] | None]:
    """What of the arrays depends on the camera: origin, reach and interval."""
    origin = scene_origin(scene.camera)
    reach = camera_reach(scene.camera.opened, origin)
    return origin, reach, scene.camera.interval if scene.has_motion else None


def _light_sampler(job: RenderJob) -> str:
    """The requested light sampler; ``auto`` is replaced by the integrator's choice."""
    asked = job.settings.light_sampler
    return job.integrator.auto_light_sampler if asked == "auto" else asked


def _compensated(job: RenderJob) -> bool:
    """Whether there is an environment that is sampled both by light sampling and by BSDF sampling."""
    if job.scene.environment is None and job.scene.sky is None:
        return False
    settings = job.settings.struct(1, job.integrator.fixed)
    return bool(settings["light_samples"][0] and settings["bsdf_samples"][0])


def _flattened(job: RenderJob, known: KnownMoves, emitted: Mapping[int, Emitted] | None) -> FlatScene:
    settings = job.settings
    flat = flatten(
        job.scene,
        settings.width,
        settings.height,
        _light_sampler(job),
        compensated=_compensated(job),
        known=known,
        emitted=emitted,
    )
    if job.lit_by is not None:
        flat = lit_by(flat, job.lit_by)
    if settings.termination is None:
        return flat
    materials = flat.arrays["materials"].copy()
    materials["color"][:, 3] = settings.termination
    return dataclasses.replace(flat, arrays={**flat.arrays, "materials": materials})
