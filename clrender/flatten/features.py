"""What a scene has that kernels are compiled for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from clrender import layout
from clrender.flatten.lamps import LAMP_KINDS, POINT_KINDS
from clrender.plugins import kernel_files

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from clrender.flatten.instances import FlatInstances
    from clrender.flatten.media import Media
    from clrender.plugins import Plugin

__all__ = ["Features"]

_CALIBRATED: Final = (layout.CAMERA_BROWN_CONRADY, layout.CAMERA_KANNALA_BRANDT)


_CARRIED: Final = (*POINT_KINDS, layout.LIGHT_DIRECTIONAL)
"""Kinds of lights that are no surfaces and may move."""
_RARE: Final = (
    "motion",
    "moving_lights",
    "deformation",
    "grids",
    "glowing_media",
    "curves",
    "hair",
    "measured",
    "dispersion",
    "iridescence",
)
"""Features that no program for any scene has."""


@dataclass(frozen=True)
class Features:
    """Each is a macro of the kernels by the same name, in capitals: a scene pays for nothing that it does not have.

    Attributes
    ----------
    materials : bool
        Some material has rows of its own, so that all lobes are needed.
    beckmann, turned_glass : bool
        Some has Beckmann's facets; some glass is anisotropic.
    environment_map, lamps, sun : bool
        The environment has an image; some lights are spots or IES lights; there is a sun.
    interiors : bool
        Paths track the dielectrics and media that they are inside.
    media, equiangular : bool
        Some medium scatters; one outside of all shapes does.
    subsurface : bool
        Some material is subsurface.
    straight_shadows : bool
        Some surfaces transmit light undeflected without bounding a medium: `clrender.flatten.media.Media`.
    camera_cuts_media : bool
        Rays of the camera may begin in different media.
    calibrated_camera : bool
        The camera's lens has distortion, or its axes are skewed.
    instances : bool
        There are instances of groups.
    opacity, holes : bool
        Rays may pass through some surfaces; of some triangles it is known where.
    hidden_shapes, hidden_environment : bool
        The camera does not see some shapes; it does not see the environment.
    textures, tangents : bool
        Some shapes have attributes; some triangles have vertex tangents.
    emission_textures : bool
        Some shapes have textured emission.
    terminator_offset : bool
        Some shape's shadow terminator is moved.
    motion : bool
        Something moves while the shutter is open, or rows of the image are exposed one after the other.
    moving_lights : bool
        So do lights at a point, or in a direction.
    deformation : bool
        Some meshes change their form while the shutter is open.
    grids : bool
        The density of some medium is a grid.
    glowing_media : bool
        Some medium shines.
    curves, hair : bool
        Some shapes are curves; some material is hair.
    measured : bool
        Some material's reflectance is measured.
    dispersion : bool
        Some index of refraction depends on the wavelength, where wavelengths are rendered.
    iridescence : bool
        Some material has a thin film.
    plugins : tuple of (str, str)
        Names and texts of the kernel files that some materials' plugins make; see `clrender.plugins.kernel_files`.
    """

    materials: bool = False
    beckmann: bool = False
    turned_glass: bool = False
    environment_map: bool = False
    lamps: bool = False
    sun: bool = False
    interiors: bool = False
    media: bool = False
    equiangular: bool = False
    subsurface: bool = False
    straight_shadows: bool = False
    camera_cuts_media: bool = False
    calibrated_camera: bool = False
    instances: bool = False
    opacity: bool = False
    holes: bool = False
    hidden_shapes: bool = False
    hidden_environment: bool = False
    textures: bool = False
    tangents: bool = False
    emission_textures: bool = False
    terminator_offset: bool = False
    motion: bool = False
    moving_lights: bool = False
    deformation: bool = False
    grids: bool = False
    glowing_media: bool = False
    curves: bool = False
    hair: bool = False
    measured: bool = False
    dispersion: bool = False
    iridescence: bool = False
    plugins: tuple[tuple[str, str], ...] = ()

    @property
    def macros(self) -> dict[str, int | str]:
        """Macros of the features that are there."""
        return {each.name.upper(): 1 for each in fields(self) if getattr(self, each.name)} | dict(self.plugins)

    @property
    def rare(self) -> bool:
        """Whether there is any that no program for any scene has."""
        return any(getattr(self, name) for name in _RARE)

    @classmethod
    def all(cls, plugins: tuple[tuple[str, str], ...] = ()) -> Features:
        """All but the rare ones: a program for these renders any scene without those, if told what it has (`stated`).

        Parameters
        ----------
        plugins : tuple of (str, str)
            Those of the scene: no program has any plugin.
        """
        flags: dict[str, Any] = {each.name: each.name not in _RARE for each in fields(cls) if each.type == "bool"}
        return cls(**flags, plugins=plugins)

    def stated(self, masked: bool) -> int:
        """Features that kernels are not only able to handle but take for granted: ``HAS_*``.

        Parameters
        ----------
        masked : bool
            Whether there is a BVH of masked primitives.
        """
        stated = {
            layout.HAS_MASKED: masked,
            layout.HAS_SUN: self.sun,
            layout.HAS_HIDDEN_ENVIRONMENT: self.hidden_environment,
            layout.HAS_ENVIRONMENT_MAP: self.environment_map,
            layout.HAS_STRAIGHT_SHADOWS: self.straight_shadows,
            layout.HAS_LAMPS: self.lamps,
            layout.HAS_HOLES: masked and self.holes,
            layout.HAS_CAMERA_CUTS_MEDIA: self.camera_cuts_media,
        }
        return sum(flag for flag, has in stated.items() if has)

    def seen_by(self, camera: NDArray[np.void], moves: bool) -> Features:
        """The features of the same scene with another camera.

        Parameters
        ----------
        camera : (n,) `Camera`
            One, or several for a batch.
        moves : bool
            Whether anything but the camera moves.
        """
        return replace(
            self,
            camera_cuts_media=self.interiors and bool(camera["cuts_media"].any()),
            calibrated_camera=bool(np.isin(camera["kind"], _CALIBRATED).any()),
            motion=moves or bool((camera["segments"] > 0).any()),
        )

    @classmethod
    def of(
        cls,
        arrays: Mapping[str, NDArray[Any]],
        camera: NDArray[np.void],
        media: Media,
        instances: FlatInstances,
        hidden_environment: bool,
        plugins: Sequence[Plugin] = (),
    ) -> Features:
        """The features of a flat scene.

        Parameters
        ----------
        arrays : mapping of str to ndarray
            As `clrender.flatten.flat_scene.FlatScene` has them.
        camera : (1,) `Camera`
        media : Media
        instances : FlatInstances
        hidden_environment : bool
            Whether the camera does not see the environment.
        plugins : sequence of Plugin
            Those that it uses.
        """
        lights, flags, attributes = arrays["lights"], arrays["shapes"]["flags"], arrays["attribute_rows"]
        opacity = bool((flags & layout.SHAPE_MASKED).any())
        emission_textures = bool(lights["texture"].any())
        textured = len(attributes) > 1 or bool(attributes.any()) or emission_textures
        tangents = {name: first for name, first, _, _ in layout.ROWS["ATTRIBUTE"]}["TANGENTS"]
        interiors = bool(arrays["media_rows"].any())
        found = cls(
            materials=len(arrays["albedo_tables"]) > 1,
            beckmann=len(arrays["albedo_tables"]) > layout.ALBEDO_END,
            turned_glass=len(arrays["albedo_tables"]) > layout.ALBEDO_TURNED_GLASS,
            environment_map=len(arrays["environment_map"]) > 1,
            lamps=bool(np.isin(lights["kind"], LAMP_KINDS).any()),
            sun=bool((lights["kind"] == layout.LIGHT_SUN).any()),
            interiors=interiors,
            media=interiors and media.scatters,
            equiangular=interiors and media.fog,
            subsurface=interiors and media.subsurface,
            straight_shadows=interiors and media.straight,
            instances=instances.count > 0,
            opacity=opacity,
            holes=opacity and len(arrays["hole_rows"]) > 1,
            hidden_shapes=bool((flags & (layout.SHAPE_HIDDEN | layout.SHAPE_HELD_OUT)).any()),
            hidden_environment=hidden_environment,
            moving_lights=_carries(lights),
            deformation=bool(instances.poses),
            grids=interiors and bool(media.grids),
            glowing_media=interiors and media.glows,
            textures=textured or opacity,
            tangents=bool(attributes[:, tangents].view(np.uint32).any()),
            emission_textures=emission_textures,
            terminator_offset=bool((flags & layout.SHAPE_TERMINATOR_OFFSET).any()),
            curves=bool(arrays["curve_rows"].any()),
            hair=len(arrays["albedo_tables"]) > 1 and bool((_kinds(arrays) == layout.MATERIAL_HAIR).any()),
            measured=bool(arrays["measured_rows"].any()),
            iridescence=len(arrays["thin_film_rows"]) > 1,
            plugins=tuple(kernel_files(plugins).items()) if plugins else (),
        )
        return found.seen_by(camera, instances.moves or found.moving_lights)


def _carries(lights: NDArray[np.void]) -> bool:
    """Whether any light that is no surface has a motion; a row of zeros stands for no lights."""
    there = np.isin(lights["kind"], _CARRIED) & lights["radiance"].any(axis=1)
    return bool((lights["primitive"][there] != layout.NONE).any())


def _kinds(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint32]:
    """Kind of each material that has rows."""
    first: NDArray[np.float32] = arrays["material_rows"][::2, layout.columns("MATERIAL")["KIND"]]
    return np.ascontiguousarray(first).view(np.uint32)
