"""The sides in the solution of a changing scene: hits of their rays, irradiance and reflected radiance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.radiosity.sides import carried_radiance, covered_rays, largest, lifted, side_areas

if TYPE_CHECKING:
    from clrender.device.device import Buffer, Device
    from clrender.radiosity.patches import Patches
    from clrender.radiosity.tracer import Changes

__all__ = ["Rows", "Traced"]

_MOST_SWEEPS: Final = 1000
_WITH: Final = 0.5
"""Sides with at least this fraction of the residual are shot in the same sweep, to save a later one."""

_Floats = NDArray[np.float64]
_Uints = NDArray[np.uint32]


@dataclass(frozen=True)
class Traced:
    """Results of the rays and shadow rays of some sides.

    Attributes
    ----------
    sides : (r,) uint32
    hits : (r, rays) uint32
        Sides that rays hit, or 2 n.
    irradiance : (r, 3) float64
        Direct, W/m².
    seen : (r,) uint32
        One bit per unoccluded shadow ray.
    """

    sides: _Uints
    hits: _Uints
    irradiance: _Floats
    seen: _Uints


class Rows:
    """Sides in use, one row each; hits stay on the device, where sweeps run in single precision.

    Parameters
    ----------
    device : Device
    traced : Traced
    sealed : (2 n + 1,) bool

    Attributes
    ----------
    sides : (r,) uint32
    irradiance : (r, 3) float64
    seen : (r,) uint32
    hits : Buffer
        (r, rays) uint32.
    rays : int
        Rays of each side.
    """

    def __init__(self, device: Device, traced: Traced, sealed: NDArray[np.bool_]) -> None:
        self._device, self._program = device, device.program("radiosity/sweep.cl")
        self.sides, self.irradiance, self.seen = traced.sides, traced.irradiance, traced.seen
        self.rays, self._columns = traced.hits.shape[1], len(sealed)
        self.hits: Buffer = device.upload(traced.hits)
        self._covered = covered_rays(traced.hits, sealed)
        self._reflected = np.zeros((len(self.sides), 3))
        self._arriving: _Floats | None = None
        self._sent, self._got = np.zeros((len(sealed), 4), np.float32), np.empty((len(self.sides), 4), np.float32)
        self._wide, self._out = device.empty(self._sent.nbytes), device.empty(self._got.nbytes)

    @property
    def met(self) -> _Uints:
        """(r, rays) uint32: `hits`, read from the device."""
        met = np.empty((len(self.sides), self.rays), np.uint32)
        self._device.read(self.hits, met)
        return met

    @property
    def used(self) -> NDArray[np.bool_]:
        """(2 n + 1,) bool: sides that have a row."""
        used = np.zeros(self._columns, bool)
        used[self.sides] = True
        return used

    @property
    def reflected(self) -> _Floats:
        """(2 n + 1, 3) float64: radiance that each side reflects."""
        return self._spread(self._reflected)

    def indirect(self, patches: Patches) -> _Floats:
        """(2 n + 1, 3) float64: `reflected` without direct light from shadow rays."""
        return self._spread(self._reflected - self._reflectance(patches) * self.irradiance / math.pi)

    def shown(self, patches: Patches) -> _Floats:
        """(2 n + 1, 3) float64: `reflected`, but for textured sides as if they were white."""
        return self._shown(patches, self.reflected, self.irradiance / math.pi)

    def shown_indirect(self, patches: Patches) -> _Floats:
        """(2 n + 1, 3) float64: `indirect`, but for textured sides as if they were white."""
        return self._shown(patches, self.indirect(patches), np.zeros_like(self.irradiance))

    def _shown(self, patches: Patches, plain: _Floats, straight: _Floats) -> _Floats:
        if not patches.textured.any():
            return plain
        assert self._arriving is not None
        white = lifted(np.ones_like(straight), 1.0 - self._covered / self.rays)
        return np.where(patches.textured_sides[:, None], self._spread(white * (self._arriving + straight)), plain)

    @property
    def open_share(self) -> _Floats:
        """(2 n + 1,) float64: uncovered fraction of each side's area; 1 for those without a row."""
        share = np.ones(self._columns)
        share[self.sides] = 1.0 - self._covered / self.rays
        return share

    def joined(self, more: Traced, sealed: NDArray[np.bool_]) -> Rows:
        """These rows joined with others, sides ascending; these rows must not be used afterwards."""
        sides = np.concatenate([self.sides, more.sides])
        order = np.argsort(sides, kind="stable")
        hits = np.concatenate([self.met, more.hits])[order]
        irradiance = np.concatenate([self.irradiance, more.irradiance])[order]
        seen = np.concatenate([self.seen, more.seen])[order]
        rows = Rows(self._device, Traced(sides[order], hits, irradiance, seen), sealed)
        rows._reflected = np.concatenate([self._reflected, np.zeros((len(more.sides), 3))])[order]
        self.release()
        return rows

    def take(self, changes: Changes) -> None:
        """Update the residuals for rays whose hits changed; `hits` is already up to date."""
        assert self._arriving is not None
        self._arriving += changes.brought
        self._covered += changes.covered

    def cover(self, sealed: NDArray[np.bool_]) -> None:
        """Update the covered fractions for these sealed sides."""
        self._covered = covered_rays(self.met, sealed)

    def settle(self, patches: Patches, tolerance: float, weights: _Floats | None) -> int:
        """Shoot the residual of sides until it is small.

        Parameters
        ----------
        patches : Patches
        tolerance : float
            Largest residual of a side, relative to the mean radiance of the scene.
        weights : (2 n,) float64, optional
            Divides the tolerance. None: 1, and all radiance is gathered again first.

        Returns
        -------
        int
            Sweeps over all rays.
        """
        sweeps = 0
        if weights is None or self._arriving is None:
            sweeps, self._arriving = 1, self._gathered(carried_radiance(patches) + self.reflected)
        reflectance = self._reflectance(patches)
        left = reflectance * (self._arriving + self.irradiance / math.pi) - self._reflected
        weight = np.ones(len(self.sides)) if weights is None else weights[self.sides]
        areas = side_areas(patches)[self.sides]
        while sweeps < _MOST_SWEEPS:
            mean = float((largest(self._reflected + left) * areas).sum() / areas.sum())
            wrong = largest(left) * weight
            if not (wrong > tolerance * mean).any():
                break
            now = np.where((wrong > _WITH * tolerance * mean)[:, None], left, 0.0)
            got = self._gathered(self._spread(now))
            self._reflected += now
            self._arriving += got
            left += reflectance * got - now
            sweeps += 1
        return sweeps

    def _reflectance(self, patches: Patches) -> _Floats:
        return lifted(patches.reflectance[self.sides // 2], 1.0 - self._covered / self.rays)

    def _spread(self, radiance: _Floats) -> _Floats:
        wide = np.zeros((self._columns, 3))
        wide[self.sides] = radiance
        return wide

    def _gathered(self, sent: _Floats) -> _Floats:
        """Mean radiance, (r, 3), along the rays of each row, from the radiance of sides, (2 n + 1, 3)."""
        device = self._device
        self._sent[:, :3] = sent
        device.write(self._wide, self._sent)
        span = [np.uint32(len(self.sides)), np.uint32(self.rays), np.float32(1.0 / self.rays)]
        device.launch_each(self._program, "radiosity_sweep", len(self.sides), [self.hits, *span, self._wide, self._out])
        device.read(self._out, self._got)
        return self._got[:, :3].astype(np.float64)

    def release(self) -> None:
        """Release the device's memory."""
        for buffer in (self.hits, self._wide, self._out):
            self._device.release(buffer)
