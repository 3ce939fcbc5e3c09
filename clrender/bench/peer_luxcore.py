"""Renders a benchmark scene with LuxCore's CPU path tracer; run by a Python that has pyluxcore. See peer_scene.py."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
import pyluxcore
from peer_scene import Job, answer, camera_of, job, parts_of, refuse_rich

__all__: list[str] = []

NEVER = 10**6


def properties(values: dict[str, Any]) -> Any:
    made = pyluxcore.Properties()
    for name, value in values.items():
        made.Set(pyluxcore.Property(name, value if isinstance(value, list) else [value]))
    return made


def material(name: str, described: dict[str, Any], emission: list[float] | None) -> dict[str, Any]:
    start = f"scene.materials.{name}."
    if described["type"] == "mirror":
        return {f"{start}type": "mirror", f"{start}kr": list(described["reflectance"])}
    if described["type"] == "dielectric":
        values = {
            "type": "glass",
            "kr": [1.0] * 3,
            "kt": [1.0] * 3,
            "interiorior": described["ior"],
            "exteriorior": 1.0,
        }
        return {start + key: value for key, value in values.items()}
    matte: dict[str, Any] = {"type": "matte", "kd": list(described["reflectance"])}
    if emission is not None:
        matte |= {
            "emission": list(emission), "emission.gain": [1.0] * 3, "emission.power": 0.0, "emission.efficency": 0.0,
            "emission.gain.normalizebycolor": 0,
        }  # fmt: skip
    return {start + key: value for key, value in matte.items()}


def load(one: Job) -> Any:
    camera, scene = camera_of(one), pyluxcore.Scene()
    scene.Parse(properties({
        "scene.camera.type": "perspective", "scene.camera.lookat.orig": list(camera["position"]),
        "scene.camera.lookat.target": list(camera["target"]), "scene.camera.up": [0.0, 1.0, 0.0],
        "scene.camera.fieldofview": camera["vertical_fov"], "scene.camera.autofocus.enable": 0,
        "scene.camera.lensradius": 0.0,
    }))  # fmt: skip
    for part in parts_of(one)[0]:
        scene.Parse(properties(material(part.name, part.material, part.emission)))
        normals = None if part.normals is None else [tuple(row) for row in part.normals.tolist()]
        vertices, faces = ([tuple(row) for row in rows.tolist()] for rows in (part.vertices, part.faces))
        scene.DefineMesh(f"mesh_{part.name}", vertices, faces, normals, None, None, None)
        place = f"scene.objects.{part.name}."
        scene.Parse(properties({f"{place}shape": f"mesh_{part.name}", f"{place}material": part.name}))
    return scene


def main() -> None:
    begin = time.perf_counter()
    one = job()
    refuse_rich(one, "LuxCore")
    pyluxcore.Init(lambda _: None)
    scene, events = load(one), one.segments - 1
    config = pyluxcore.RenderConfig(properties({
        "renderengine.type": one.variant, "native.threads.count": len(os.sched_getaffinity(0)),
        "film.width": one.width, "film.height": one.height, "film.filter.type": "NONE",
        "film.imagepipelines.0.0.type": "NOP", "film.noiseestimation.warmup": NEVER,
        "path.pathdepth.total": events, "path.pathdepth.diffuse": events, "path.pathdepth.glossy": events,
        "path.pathdepth.specular": events, "path.russianroulette.depth": NEVER,
        "path.clamping.variance.maxvalue": 0.0, "path.hybridbackforward.enable": 0,
        "sampler.type": "SOBOL", "sampler.sobol.adaptive.strength": 0.0, "batch.haltspp": [one.spp, 0],
    }), scene)  # fmt: skip
    session = pyluxcore.RenderSession(config)
    session.Start()
    setup = time.perf_counter() - begin
    wall, cpu = time.perf_counter(), time.process_time()
    while not session.HasDone():
        time.sleep(0.02)
        session.UpdateStats()
        if session.GetStats().Get("stats.renderengine.pass").GetInt() >= one.spp:
            break
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    session.UpdateStats()
    taken = session.GetStats().Get("stats.renderengine.total.samplecount").GetFloat() / (one.width * one.height)
    session.Stop()
    film = np.zeros(one.width * one.height * 3, np.float32)
    session.GetFilm().GetOutputFloat(pyluxcore.FilmOutputType.RGB, film, 0)
    # LuxCore's film is one row of pixels lower than others'; the additional row is not compared.
    image = np.roll(film.reshape(one.height, one.width, 3)[::-1], -1, 0)
    answer(one, image, wall, cpu, pyluxcore.Version(), setup, spp_taken=round(taken, 3))
    os._exit(0)


if __name__ == "__main__":
    main()
