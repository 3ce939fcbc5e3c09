"""Which materials and lights an integrator supports."""

from __future__ import annotations

from collections.abc import Sequence

from clrender.errors import SceneError
from clrender.flatten.emission import emits
from clrender.flatten.material_rows import has_row
from clrender.flatten.plugin_rows import used_plugins
from clrender.integrators import INTEGRATORS
from clrender.scene.camera import Camera
from clrender.scene.description import Scene
from clrender.scene.light_kinds import MOVING_LIGHTS
from clrender.scene.materials import Dielectric, Principled, Subsurface, material_textures
from clrender.scene.motion import rests
from clrender.scene.poses import MotionKey
from clrender.scene.shapes import Curves, Mesh
from clrender.scene.textures import Checker, ImageTexture, PluginTexture, Ramp
from clrender.wording import place

__all__ = ["check_materials", "check_motion"]


def check_materials(scene: Scene, integrator: str) -> None:
    """Check that an integrator supports the materials of all shapes, and the environment.

    Parameters
    ----------
    scene : Scene
    integrator : str
        Name.

    Raises
    ------
    SceneError
        The message names the first unsupported shape or light, and a remedy.
    """
    used_plugins(scene)
    light = scene.environment
    if light is not None and light.file is not None and not INTEGRATORS[integrator].environment_pictures:
        raise SceneError(
            f"{scene.source}: lights[{scene.lights.index(light)}].file: the integrator {integrator} takes no picture "
            "of the environment; give its radiance instead, or use --integrator path"
        )
    if scene.sky is not None and not INTEGRATORS[integrator].environment_pictures:
        raise SceneError(
            f"{scene.source}: lights[{scene.lights.index(scene.sky)}].type: the integrator {integrator} takes no "
            "sun_sky; give a directional light and an environment with a radiance instead, or use --integrator path"
        )
    takes = INTEGRATORS[integrator]
    taken, volumes = takes.materials, takes.volumes
    if not takes.media:
        _refuse_media(scene, integrator)
    for name in () if takes.glowing_media else sorted(scene.used_media()):
        if scene.media[name].glows:
            raise SceneError(
                f"{scene.source}: {place(('media', name, 'emission'))}: media that shine are not for the integrator "
                f"{integrator}; leave it out, or use --integrator path"
            )
    _refuse_masked(scene, integrator)
    _refuse_hidden(scene, integrator)
    for at, shape in scene.all_shapes():
        if isinstance(shape, Curves) and not takes.curves:
            raise SceneError(
                f"{scene.source}: {place(at)}: the integrator {integrator} takes no curves; use a mesh of them, or "
                "--integrator path"
            )
        material = scene.materials[shape.material] if shape.material is not None else None
        if isinstance(material, Dielectric | Principled) and not volumes:
            for key in ("priority", "attenuation_color"):
                if getattr(material, key, None) is not None:
                    raise SceneError(
                        f"{scene.source}: {place(at)}.material: {shape.material!r} has {key}, which the integrator "
                        f"{integrator} does not take; leave it out, or use --integrator path"
                    )
        if taken and material is not None and (material.type not in taken or has_row(material)):
            of = f"of type {material.type}"
            if material.type in taken:
                rough = isinstance(material, Dielectric) and material.rough
                thin = isinstance(material, Dielectric)
                of += " with roughness" if rough else " and thin" if thin else ", not two_sided"
            raise SceneError(
                f"{scene.source}: {place(at)}.material: {shape.material!r} is {of}, which the integrator "
                f"{integrator} does not take; give the shape a {'smooth ' if 'dielectric' in taken else ''}material "
                f"of type {' or '.join(taken)}, or use --integrator path"
            )
        if isinstance(shape.emission, ImageTexture | Checker | Ramp) and not takes.emission_textures:
            raise SceneError(
                f"{scene.source}: {place(at)}.emission is a texture, which the integrator {integrator} does not "
                "take; give it a constant, or use --integrator path"
            )
        textures = () if shape.material is None else material_textures(scene.materials, shape.material)
        given = takes.textures
        refused = [
            key for key, each in textures
            if given is not None and (key not in given or isinstance(each, PluginTexture))
        ]  # fmt: skip
        if refused:
            cure = "leave it out" if refused[0] in ("normal_map", "bump_map") else "give it a constant"
            raise SceneError(
                f"{scene.source}: {place(at)}.material: {shape.material!r} has a texture ({refused[0]}), which "
                f"the integrator {integrator} does not take; {cure}, or use --integrator path"
            )
        colored = shape.color_key if isinstance(shape, Mesh) else None
        if colored and not takes.vertex_colors:
            raise SceneError(
                f"{scene.source}: {place(at)}.{colored}: the integrator {integrator} takes no colours of vertices; "
                "leave them out, or use --integrator path"
            )


def check_motion(scene: Scene, integrator: str) -> None:
    """Check that an integrator supports what moves while the shutter of the camera is open.

    Parameters
    ----------
    scene : Scene
    integrator : str
        Name.

    Raises
    ------
    SceneError
        The message names the first thing that moves, or the rolling shutter, and a remedy.
    """
    times, camera = INTEGRATORS[integrator].times, scene.camera
    if times == "pixel" or camera.interval[0] == camera.interval[1]:
        return
    moving = [] if camera.track is None else ["camera.motion"]
    if scene.has_motion:
        begin, end = camera.interval
        keyed: list[tuple[tuple[str | int, ...], Sequence[MotionKey]]]
        keyed = [(("shapes", index), shape.motion) for index, shape in enumerate(scene.shapes)]
        keyed += [(at, shape.motion) for at, shape in scene.all_shapes() if at[0] == "groups"]
        moving += [place((*at, "motion")) for at, keys in keyed if keys and rests(keys, begin, end) is None]
        lamps = ((i, each.motion) for i, each in enumerate(scene.lights) if isinstance(each, MOVING_LIGHTS))
        moving += [place(("lights", i, "motion")) for i, keys in lamps if keys and rests(keys, begin, end) is None]
    if moving and not times:
        raise SceneError(
            f"{scene.source}: {moving[0]}: the integrator {integrator} takes nothing that moves while the shutter is "
            f"open; leave {_open_for(camera)} out, or use --integrator path"
        )
    if moving and camera.row_share < 1.0:
        raise SceneError(
            f"{scene.source}: camera.rolling_shutter: rows of one image have the same time in the integrator "
            f"{integrator}; leave it out, or use --integrator path"
        )


def _open_for(camera: Camera) -> str:
    """The keys of a camera for which an interval of time is rendered."""
    keys = ["camera.shutter"] if isinstance(camera.shutter, tuple) and camera.shutter[0] != camera.shutter[1] else []
    return " and ".join([*keys, *(["camera.rolling_shutter"] if camera.rolling_shutter > 0.0 else [])])


def _refuse_masked(scene: Scene, integrator: str) -> None:
    """Refuse opacity if unsupported; whitted samples lights at their centres, which may be transparent."""
    for at, shape in scene.all_shapes():
        if shape.material is None or not scene.materials[shape.material].masked:
            continue
        shines = integrator == "whitted" and emits(scene, shape)
        if shines or not INTEGRATORS[integrator].opacity:
            what = "opacity and shines" if shines else "opacity"
            raise SceneError(
                f"{scene.source}: {place(at)}.material: {shape.material!r} has {what}, which the integrator "
                f"{integrator} does not take; leave it out, or use --integrator path"
            )


def _refuse_hidden(scene: Scene, integrator: str) -> None:
    """Refuse what the camera does not see, where all see the same patches."""
    hidden = [place(at) for at, shape in scene.all_shapes() if not shape.visible_to_camera]
    hidden += [
        f"lights[{scene.lights.index(light)}]"
        for light in (scene.environment, scene.sky)
        if light is not None and not light.visible_to_camera
    ]
    if hidden and not INTEGRATORS[integrator].opacity:
        if hidden[0].startswith("lights[") and (scene.origin or {}).get("hide_environment"):
            raise SceneError(
                f"{scene.source}: the environment is hidden (--alpha, hide_environment), which the integrator "
                f"{integrator} does not take; leave that out, or use --integrator path"
            )
        raise SceneError(
            f"{scene.source}: {hidden[0]}.visible_to_camera is false, which the integrator {integrator} does not take; "
            "leave it out, or use --integrator path"
        )
    caught = [place(at) for at, shape in scene.all_shapes() if shape.shadow_catcher]
    if caught and not INTEGRATORS[integrator].opacity:
        raise SceneError(
            f"{scene.source}: {caught[0]}.shadow_catcher is true, which the integrator {integrator} does not take; "
            "leave it out, or use --integrator path"
        )


def _refuse_media(scene: Scene, integrator: str) -> None:
    """Refuse media if unsupported."""
    where = "fog" if scene.fog is not None else None
    filled = (place((*at, "interior")) for at, shape in scene.all_shapes() if shape.interior is not None)
    if (where := next(filled, where)) is not None:
        raise SceneError(
            f"{scene.source}: {where} is a medium, which the integrator {integrator} does not take; leave it out, or "
            "use --integrator path"
        )
    for at, shape in scene.all_shapes():
        if shape.material is not None and isinstance(scene.materials[shape.material], Subsurface):
            raise SceneError(
                f"{scene.source}: {place(at)}.material: {shape.material!r} is of type subsurface, which the "
                f"integrator {integrator} does not take; give the shape another, or use --integrator path"
            )
