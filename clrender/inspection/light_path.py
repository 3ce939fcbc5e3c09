"""A light path as data: its vertices, and what was added to its radiance at each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Addition", "Guidance", "LightPath", "LightSubpath", "PathVertex", "Roulette", "Splat", "Splats"]

_Floats = npt.NDArray[np.float32]
_Places = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Addition:
    """Radiance that was added to a path at one of its vertices, or that a light sample failed to add.

    Attributes
    ----------
    strategy : str
        ``light sample``: of a point of a light, by a shadow ray. ``emission``: the path ran into the light.
        ``specular chain``: over mirrors or glass (`specular_chains`). ``medium emission``: the medium shines.
        ``light centre``: of integrator `whitted`, to the centre of a light. ``connection``: of integrator `bdpt`, with
        a vertex of a path from a light.
    order : int
        Number of the addition in the path, from 1; 0: nothing was added.
    light : int or None
        Number of the light in the scene as kernels read it.
    light_kind : str or None
        Such as ``triangle``, ``sphere``, ``environment``, ``sun`` or ``point``.
    object : str or None
        Name of the shape that is the light.
    light_group : str or None
        Its light group.
    position : (3,) float64 or None
        Point of the light, world space, metres; None if it is infinitely far away, or not a point. Of a connection, the
        vertex of the light path.
    direction : (3,) float32 or None
        Unit vector towards it, world space.
    emitted : (3,) float32
        Radiance from there, W/(sr m2); of a light without extent, what stands for it; of a connection, the flux that
        arrives at the vertex of the light path, W.
    light_probability : float
        Probability with which light sampling chooses this light at the vertex.
    light_pdf : float
        Density with which light sampling finds this direction, with the choice of the light, per steradian; of a light
        without extent, the probability of the choice; of a connection, density with which the light path would have
        gone on to the vertex.
    bsdf_pdf : float
        Density with which directions of the BSDF, and of the guiding field, find it, per steradian; 0: a delta.
    camera_vertices, light_vertices : int or None
        The strategy: how many vertices of the path are of its part from the camera, the camera among them, and how many
        of its part from a light, that on the light among them. Surfaces that are no boundary do not count. None: of
        specular chains and of integrator `whitted`.
    weight : float or None
        MIS weight with which it counts; 1 if no other strategy could have found it. None: of specular chains.
    light_weight, bsdf_weight : float or None
        MIS weights of light samples and of directions of the BSDF, by the balance heuristic. One of them is `weight`.
        None: of integrator `bdpt`, which has more strategies than two.
    in_full : bool
        Whether light sampling could not have found it, so that it counts in full.
    delta : bool
        Whether the light has no extent, so that only light sampling finds it.
    shadow_ray : bool
        Whether a shadow ray was traced. None is if nothing would arrive.
    arrives : bool
        Whether nothing is in the way.
    unshadowed : (3,) float32
        What is added if nothing is in the way.
    added : (3,) float32
        What was added to the radiance of the path, W/(sr m2); with wavelengths, at each of the three.
    contribution : (3,) float32
        The same as red, green and blue, times the weight of the pixel filter.
    light_path : LightSubpath or None
        Of a connection whose ray was traced: the path from the light.
    """

    strategy: str
    order: int
    light: int | None
    light_kind: str | None
    object: str | None
    light_group: str | None
    position: _Places | None
    direction: _Floats | None
    emitted: _Floats
    light_probability: float
    light_pdf: float
    bsdf_pdf: float
    camera_vertices: int | None
    light_vertices: int | None
    weight: float | None
    light_weight: float | None
    bsdf_weight: float | None
    in_full: bool
    delta: bool
    shadow_ray: bool
    arrives: bool
    unshadowed: _Floats
    added: _Floats
    contribution: _Floats
    light_path: LightSubpath | None


@dataclass(frozen=True)
class LightSubpath:
    """The part of a path that began at a light, as far as the vertex that it was connected with the camera's part at.

    Attributes
    ----------
    number : int
        Number of the light path among those of its sample of all pixels.
    stands_for : float
        Number of vertices of the light path, of which this one was drawn: it counts for all of them.
    light : int
        Number of the light.
    light_kind : str
        As of `Addition`.
    object, light_group : str or None
        As of `Addition`.
    position : (3,) float64 or None
        Where it began, world space, metres; None if the light is infinitely far away.
    direction : (3,) float32
        Unit vector in which it left, world space.
    flux : (3,) float32
        With which it left, W.
    vertices : tuple of PathVertex
        In order from the light on; throughputs are fluxes, W, and directions and sides those of light. The event of the
        last one is ``connection``.
    """

    number: int
    stands_for: float
    light: int
    light_kind: str
    object: str | None
    light_group: str | None
    position: _Places | None
    direction: _Floats
    flux: _Floats
    vertices: tuple[PathVertex, ...]


@dataclass(frozen=True)
class Roulette:
    """Russian roulette after a scattering event.

    Attributes
    ----------
    survival : float
        Probability with which the path goes on; its throughput was divided by it.
    random : float
        Random number in [0, 1).
    survived : bool
        Whether `random` is below `survival`.
    """

    survival: float
    random: float
    survived: bool


@dataclass(frozen=True)
class Guidance:
    """What the guiding field does at a vertex.

    Attributes
    ----------
    share : float
        Share of the directions that are drawn from the field.
    by_field : bool
        Whether this one was.
    light_share : float
        Probability that a light sample is taken.
    """

    share: float
    by_field: bool
    light_share: float


@dataclass(frozen=True)
class PathVertex:
    """A vertex of a light path.

    Attributes
    ----------
    event : str
        What happened: ``reflection`` and ``transmission`` (to the side that the path came from, and to the other),
        ``specular reflection`` and ``specular transmission`` (at a delta, such as a mirror or smooth glass),
        ``scattering`` (at a point of a medium), ``straight`` (a surface that is no boundary), ``end`` (none: the path
        ended here, by `ended`), ``escape`` (the path left the scene), ``connection`` (the last vertex of a
        `LightSubpath`).
    depth : int
        Scattering events before it.
    again : bool
        Whether the path is back here, as several rays leave this vertex (`indirect_rays`).
    position : (3,) float64 or None
        World space, metres; None after an escape.
    distance : float or None
        From the vertex before, or from the camera, metres.
    normal, shading_normal : (3,) float32 or None
        Unit vectors, world space: of the geometry, out of the front; and shading normal, on the side that the path came
        from.
    front : bool
        Whether the path met the front.
    shape : int or None
        Index in the scene's list of shapes, from 0.
    object : str or None
        Name of the shape.
    material : str or None
        Name of the material.
    material_type : str or None
        Its type, such as ``lambert``; ``medium`` at a point of a medium.
    light : int or None
        Number of the light that the surface is.
    direction_in : (3,) float32
        Unit vector along the ray that arrived, world space.
    direction : (3,) float32 or None
        Unit vector in which the path goes on; None if none was sampled.
    throughput_in, throughput : (3,) float32
        With which the path arrived, and went on after the event and roulette; where several rays leave, the share of
        each.
    weight : (3,) float32 or None
        BSDF times cosine over `pdf`, of the sampled direction.
    pdf : float or None
        Its density, per steradian, of the BSDF and the guiding field; 0: a delta.
    bsdf_pdf : float or None
        Density of the BSDF alone.
    index_squared : float or None
        Squared index of refraction where the path goes on, relative to where it began.
    roulette : Roulette or None
        None: it was not played, as where the path goes straight on.
    guiding : Guidance or None
        None: the field knows nothing here.
    ended : str or None
        Why the path ends here: ``escape``, ``depth`` (`max_depth`), ``absorbed`` (it carries nothing), ``roulette``,
        ``diffuse`` (`direct` and `whitted` follow no diffuse surfaces); None: it goes on.
    additions : tuple of Addition
        In the order of the record; by `Addition.order`, in that of the additions.
    contribution : (3,) float32
        Sum of the contributions of `additions`, red, green and blue.
    """

    event: str
    depth: int
    again: bool
    position: _Places | None
    distance: float | None
    normal: _Floats | None
    shading_normal: _Floats | None
    front: bool
    shape: int | None
    object: str | None
    material: str | None
    material_type: str | None
    light: int | None
    direction_in: _Floats
    direction: _Floats | None
    throughput_in: _Floats
    throughput: _Floats
    weight: _Floats | None
    pdf: float | None
    bsdf_pdf: float | None
    index_squared: float | None
    roulette: Roulette | None
    guiding: Guidance | None
    ended: str | None
    additions: tuple[Addition, ...]
    contribution: _Floats


@dataclass(frozen=True)
class LightPath:
    """The path of a sample of a pixel, or the paths, if they split.

    Attributes
    ----------
    index : int
        Number of the sample in the pixel, from 0.
    value : (3,) float32
        What the sample adds to the sum of its pixel, red, green and blue, W/(sr m2). The pixel is the mean.
    splat : (3,) float32 or None
        What paths from lights that the camera sees add beside it, as part of this sample, in which they count with a
        camera vertex of one; it is not in `value`. None: the integrator has no such paths.
    share : float
        Part of `value` of the luminance of the pixel; 1 / spp if all samples are alike.
    radiance : (3,) float32
        Sum of all that was added, in single precision and in the order of the additions; with wavelengths, at each of
        the three. `value` is this as red, green and blue, times `filter_weight`.
    wavelengths : (3,) float32 or None
        Of the sample, nm; None without `spectral`.
    filter_weight : float
        Weight of the pixel filter, negative where the filter is.
    origin : (3,) float64
        Where the ray of the camera begins, world space, metres.
    direction : (3,) float32
        Unit vector along this ray.
    time : float
        When it was sent, from 0 to 1 while the shutter is open.
    finite : bool
        Whether the sample counts: samples that are not finite, or brighter than 2^43, are left out.
    vertices : tuple of PathVertex
    rows_left_out : int
        Vertices and additions that were not recorded, because the path is too long.
    rest : (3,) float32
        Part of `radiance` that these added.
    """

    index: int
    value: _Floats
    splat: _Floats | None
    share: float
    radiance: _Floats
    wavelengths: _Floats | None
    filter_weight: float
    origin: _Places
    direction: _Floats
    time: float
    finite: bool
    vertices: tuple[PathVertex, ...]
    rows_left_out: int
    rest: _Floats


@dataclass(frozen=True)
class Splat:
    """What one path from a light brings to a pixel, in which the camera sees one of its vertices.

    Attributes
    ----------
    sample : int
        Number of the sample of all pixels that the light path is of.
    path : int
        Number of the light path among those of its sample.
    value : (3,) float32
        What it adds to the sum of the pixel, red, green and blue, W/(sr m2).
    share : float
        Part of it of the luminance of the pixel, as of `LightPath`.
    weight : float
        MIS weight with which it counts.
    light_vertices : int
        Vertices of the light path as far as that one, the one on the light among them; the camera is the only other.
    light_path : LightSubpath or None
        The light path, whose last vertex is that one; None if it is too long to be recorded.
    """

    sample: int
    path: int
    value: _Floats
    share: float
    weight: float
    light_vertices: int
    light_path: LightSubpath | None


@dataclass(frozen=True)
class Splats:
    """What paths from lights bring to a pixel in which the camera sees them: they belong to no path from the camera.

    Attributes
    ----------
    values : (spp, 3) float32
        What they add as part of each sample, by number; 0 of samples that are left out.
    splatted : (3,) float32
        The mean of these: their part of the pixel, W/(sr m2).
    camera : (3,) float32
        The rest of the pixel: the mean of `clrender.PixelPaths.values`, which are of paths from the camera.
    count : int
        Number of splats; those of a sample add up to its row of `values`.
    paths : tuple of Splat
        Those with the largest contributions, by luminance, the largest first.
    """

    values: _Floats
    splatted: _Floats
    camera: _Floats
    count: int
    paths: tuple[Splat, ...]
