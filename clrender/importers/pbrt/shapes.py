"""Converts pbrt's shapes to ours."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.curves import bezier_segments
from clrender.importers.pbrt.materials import MaterialReader
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.state import Graphics
from clrender.importers.pbrt.textures import TextureReader
from clrender.importers.shared.loop_subdivision import subdivided
from clrender.importers.shared.matrices import Matrix, is_affine
from clrender.importers.shared.meshes import (
    cylinder_mesh,
    disk_part_mesh,
    faced_by_normals,
    patches_mesh,
    quads_mesh,
    sphere_part_mesh,
    with_uvs,
)
from clrender.importers.shared.staging import Staging
from clrender.importers.shared.strands import StrandCollector, has_inside, placed_rows, ribbon_mesh
from clrender.meshes.data import MeshData
from clrender.wording import counted, quoted

__all__ = ["ShapeReader"]

_CORNERS: Final = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
"""Texture coordinates of triangles that have none."""

_POLES: Final = np.array([[0.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From our sphere to pbrt's: u runs from 0 at +x, v from 0 at -z."""


@dataclass(frozen=True)
class _Curve:
    """A strand of pbrt: (K, 4, 3) control points, widths at both ends, and of a ribbon (K + 1, 3) normals."""

    controls: NDArray[np.float64]
    widths: tuple[float, float]
    normals: NDArray[np.float64] | None

    @property
    def rows(self) -> NDArray[np.float64]:
        """(3 K + 1, 4) control points, and radii."""
        joined = np.concatenate([self.controls[:1, 0], self.controls[:, 1:].reshape(-1, 3)])
        first, last = self.widths
        radii = (first + (last - first) * np.arange(len(joined)) / (len(joined) - 1)) / 2.0
        return np.column_stack([joined, np.maximum(radii, 0.0)])  # a tip of width 0 may be less by a rounding


class ShapeReader:
    """Converts shapes.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    materials : MaterialReader
    strands : StrandCollector
        Gets curves.
    """

    def __init__(
        self, staging: Staging, textures: TextureReader, materials: MaterialReader, strands: StrandCollector
    ) -> None:
        self._staging, self._textures, self._materials, self._strands = staging, textures, materials, strands
        self._count = 0

    def curve(self, parameters: Parameters, state: Graphics, matrix: Matrix, group: Hashable) -> dict[str, Any] | None:
        """A curve, which goes into the shape of others of its material, if there is one.

        Parameters
        ----------
        parameters : Parameters
        state : Graphics
        matrix : (4, 4) float64
            Acts on it here.
        group : hashable
            What else sets its shape apart.

        Returns
        -------
        dict or None
            The description of a new shape.
        """
        curve = self._strand(parameters)
        if state.emission is not None:
            self._staging.note("curves do not shine here: their light is left out")
        described = self._surface(parameters, replace(state, emission=None), None)
        if has_inside(self._staging.draft, described.get("material")):
            self._staging.note("curves of what has an inside are left out: they have none here")
            return None
        parameters.ignore("alpha", "splitdepth", "type", "N", "width", "width0", "width1", "degree", "basis", "P")
        for unknown in parameters.unused():
            self._staging.note(f'{quoted(unknown)} of a shape of type "curve" is not understood and does nothing')
        if not described:
            return None
        if not is_affine(matrix):
            self._staging.leave_out(parameters.line, "the curve's transform cannot be inverted; give it another")
            return None
        key = group, described.get("material")
        if curve.normals is None:
            rows = placed_rows(self._staging.draft, curve.rows, matrix)
            made = self._strands.add(key, rows, "bezier")
        else:
            mesh = ribbon_mesh(curve.controls, curve.widths, curve.normals, matrix)
            made = self._strands.add_ribbon(key, mesh)
        return None if made is None else {**made, **described}

    def _strand(self, parameters: Parameters) -> _Curve:
        """Cubic Bezier curves, whose width is linear along all of them."""
        points = parameters.numbers("P", 3)
        degree, basis = parameters.whole("degree", 3), parameters.text("basis", "bezier").lower()
        if degree not in (2, 3) or basis not in ("bezier", "bspline"):
            raise parameters.fault(f"a curve is a bezier or bspline of degree 2 or 3, not a {basis} of {degree}")
        count = 0 if points is None else len(points)
        step = degree if basis == "bezier" else 1
        if points is None or count <= degree or (count - degree - 1) % step:
            text = f"a {basis} of degree {degree} cannot have {counted(count, 'point')}"
            raise parameters.fault(f'{text}; give {degree + 1}, {degree + 1 + step} and so on as "P"', "P")
        controls = _cubics(points, degree, basis)
        width = parameters.number("width", 1.0)
        widths = parameters.number("width0", width), parameters.number("width1", width)
        if not (min(widths) >= 0.0 and max(widths) > 0.0):
            raise parameters.fault("the curve has no width; give it a number above 0", "width")
        normals = parameters.numbers("N", 3) if parameters.text("type", "flat") == "ribbon" else None
        if parameters.text("type", "flat") == "ribbon" and (normals is None or len(normals) != len(controls) + 1):
            found = 0 if normals is None else len(normals)
            raise parameters.fault(f'the ribbon has {found} normals; give {len(controls) + 1} as "N"', "N")
        return _Curve(controls, widths, normals)

    def read(self, kind: str, parameters: Parameters, state: Graphics, interior: str | None) -> list[dict[str, Any]]:
        """A shape as descriptions without a transform; several for a two-sided light, none for an omitted shape.

        Parameters
        ----------
        kind : str
        parameters : Parameters
        state : Graphics
        interior : str or None
            Name of the medium inside it.
        """
        known: dict[str, Callable[[Parameters], dict[str, Any] | None]] = {
            "sphere": self._sphere,
            "disk": self._disk,
            "cylinder": self._cylinder,
            "trianglemesh": self._triangles,
            "bilinearmesh": self._patches,
            "plymesh": self._ply,
            "loopsubdiv": self._loop,
        }
        if kind not in known:
            self._staging.note(f"a shape of type {quoted(kind)} is not known and left out")
            return []
        described = known[kind](parameters)
        if described is None:
            return []
        described |= self._surface(parameters, state, interior)
        shown = state.emission is not None and state.emission.text("filename") != ""
        seen = {**described, "emission": {}} if shown else described
        if kind == "plymesh" and self._staging.lacks_uvs(described["file"], seen):
            described |= self._ply(parameters, mapped=True) or {}
        if described["type"] == "disk" and self._staging.is_textured(seen):
            described = {**described, **self._disk(parameters, mapped=True)}
            described = {key: value for key, value in described.items() if key not in ("radius", "height")}
        parameters.ignore("alpha")
        for unknown in parameters.unused():
            self._staging.note(
                f"{quoted(unknown)} of a shape of type {quoted(kind)} is not understood and does nothing"
            )
        if not {"material", "interior", "emission"} & set(described):
            return []
        if state.reversed and state.material() is not None:
            described["flip_normals"] = True
        return [described]

    def _surface(self, parameters: Parameters, state: Graphics, interior: str | None) -> dict[str, Any]:
        made: dict[str, Any] = {}
        material = state.material()
        if material == "":
            material = self._staging.material("default", {"type": "lambert", "reflectance": [0.5] * 3})
        if material is not None:
            made["material"] = self._with_alpha(material, parameters, state.emission is not None)
            interior = self._materials.fillings.get(material, interior)
        if interior is not None and self._staging.is_solid(made.get("material")):
            made["interior"] = interior
        elif interior is not None:
            self._staging.note("a medium inside of what lets no light in is left out")
        return made

    def _with_alpha(self, material: str, parameters: Parameters, shines: bool) -> str:
        """The material, with the shape's alpha."""
        if parameters.get("alpha") is None:
            return material
        alpha = self._textures.share(parameters, "alpha", 1.0)
        described = self._staging.draft.description["materials"][material]
        if alpha == 1.0:
            return material
        if alpha == 0.0 and shines:
            self._staging.note("a lamp of alpha 0, which pbrt lets shine without being there, is seen here")
            return material
        if described["type"] in ("dielectric", "subsurface") and not described.get("thin"):
            self._staging.note("the alpha of what has an inside is left out")
            return material
        return self._staging.material(f"{material}, with holes", {**described, "opacity": alpha})

    # --- kinds

    def _sphere(self, parameters: Parameters) -> dict[str, Any]:
        radius, turn = parameters.number("radius", 1.0), self._turn(parameters)
        if not radius > 0.0:
            raise parameters.fault(f"the sphere's radius is {radius:g}; it must be above 0", "radius")
        ends = [
            min(max(parameters.number(key, end), -radius), radius) for key, end in (("zmin", -radius), ("zmax", radius))
        ]
        low, high = min(ends), max(ends)
        if low == -radius and high == radius and turn == 1.0:
            return {"type": "sphere", "radius": radius, "own": _POLES}
        if low == high:
            raise parameters.fault("nothing is left of the sphere between zmin and zmax; give it a part", "zmin")
        name = f"sphere of radius {radius!r} from {low!r} to {high!r}, {turn!r} of a turn"
        return self._shared(name, lambda: sphere_part_mesh(radius, low, high, turn))

    def _disk(self, parameters: Parameters, mapped: bool = False) -> dict[str, Any]:
        """A disk: as triangles if it is not whole, or `mapped`, as textures lie around it."""
        radius = parameters.number("radius", 1.0)
        if not radius > 0.0:
            raise parameters.fault(f"the disk's radius is {radius:g}; it must be above 0", "radius")
        height, inner, turn = (
            parameters.number("height", 0.0),
            parameters.number("innerradius", 0.0),
            self._turn(parameters),
        )
        if inner <= 0.0 and turn == 1.0 and not mapped:
            return {"type": "disk", "radius": radius, "height": height}
        if not inner < radius:
            raise parameters.fault(
                f"the disk's hole of radius {inner:g} leaves nothing; make it smaller", "innerradius"
            )
        name = f"disk of radius {radius!r} around {inner!r} at {height!r}, {turn!r} of a turn"
        return self._shared(name, lambda: disk_part_mesh(radius, max(inner, 0.0), height, turn))

    def _cylinder(self, parameters: Parameters) -> dict[str, Any]:
        radius, low, high = (parameters.number(key, x) for key, x in (("radius", 1.0), ("zmin", -1.0), ("zmax", 1.0)))
        turn = self._turn(parameters)
        if not (radius > 0.0 and high != low):
            raise parameters.fault("the cylinder has no radius or no length; give it both")
        low, high = min(low, high), max(low, high)
        name = f"cylinder of radius {radius!r} from {low!r} to {high!r}, {turn!r} of a turn"
        return self._shared(name, lambda: cylinder_mesh(radius, low, high, turn))

    def _turn(self, parameters: Parameters) -> float:
        """The part of a turn that a round shape has."""
        degrees = parameters.number("phimax", 360.0)
        if not degrees > 0.0:
            raise parameters.fault(f"nothing is left of a shape whose phimax is {degrees:g}; give it more", "phimax")
        return min(degrees, 360.0) / 360.0

    def _triangles(self, parameters: Parameters) -> dict[str, Any]:
        places, normals, uvs = self._vertices(parameters)
        corners = parameters.indices("indices", 3, len(places))
        if corners is None:
            if len(places) != 3:
                raise parameters.fault('the mesh has no "indices", and not three points; give them')
            corners = np.array([[0, 1, 2]])
        triangles = corners.astype(np.uint32)
        with np.errstate(over="ignore"):  # infinite, which is refused
            given = None if uvs is None else uvs.astype(np.float32)[triangles]
        parameters.ignore("S", "faceIndices")
        mesh = MeshData(places, triangles, normals=normals, uvs=given)
        return self._mesh("mesh", faced_by_normals(with_uvs(mesh, _CORNERS)))

    def _loop(self, parameters: Parameters) -> dict[str, Any]:
        """A subdivided mesh, whose normals are clockwise in pbrt."""
        places, _, _ = self._vertices(parameters)
        corners = parameters.indices("indices", 3, len(places))
        if corners is None:
            raise parameters.fault('the mesh to subdivide has no "indices"; give them')
        levels = parameters.whole("levels", 3)
        try:
            points, triangles, normals, regular = subdivided(places, corners, max(levels, 0))
        except ValueError as error:
            raise parameters.fault(f'{error}, which is the most; use fewer "levels"', "levels") from None
        if not regular:
            self._staging.note("edges of other than two triangles that pass them oppositely are boundaries")
        mesh = MeshData(points, triangles.astype(np.uint32), normals=-normals)
        return self._mesh("subdivided mesh", faced_by_normals(with_uvs(mesh, _CORNERS)))

    def _patches(self, parameters: Parameters) -> dict[str, Any]:
        places, normals, uvs = self._vertices(parameters)
        corners = parameters.indices("indices", 4, len(places))
        if corners is None:
            if len(places) != 4:
                raise parameters.fault('the patches have no "indices", and not four points; give them')
            corners = np.array([[0, 1, 2, 3]])
        if uvs is None:
            kept = places[corners].reshape(-1, 3)
            normals = None if normals is None else normals[corners].reshape(-1, 3)
            uvs = np.tile(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]), (len(corners), 1))
            places, corners = kept, np.arange(len(kept)).reshape(-1, 4)
        a, b, c, d = (places[corners[:, i]] for i in range(4))
        parameters.ignore("emissionfilename")
        if not np.allclose(a + d, b + c, rtol=0.0, atol=1e-6 * float(np.abs(places).max())):
            directions = None if normals is None else normals[corners]
            return self._mesh("patches", patches_mesh(places[corners], uvs[corners], directions))
        mesh = quads_mesh(places, corners[:, [0, 1, 3, 2]], uvs, normals)
        return self._mesh("patches", faced_by_normals(mesh))

    def _vertices(self, parameters: Parameters) -> tuple[NDArray[np.float64], Any, Any]:
        """Points, normals or None, and texture coordinates or None, of equal length."""
        places = parameters.numbers("P", 3)
        if places is None or not len(places):
            raise parameters.fault('the mesh has no points "P"; give them')
        normals = parameters.numbers("N", 3)
        uvs = parameters.numbers("uv" if "uv" in parameters.values else "st", 2)
        for array, name in ((normals, "N"), (uvs, "uv")):
            if array is not None and len(array) != len(places):
                raise parameters.fault(
                    f"it has {counted(len(places), 'point')}, but {len(array)} of {quoted(name)}", name
                )
        for array, name, most in ((places, "P", 1e12), (normals, "N", 1e12), (uvs, "uv", 1e6)):
            if array is not None and not (np.abs(array) <= most).all():
                raise parameters.fault(f"a number of {quoted(name)} is larger than {most:g}, which is the most", name)
        return places, normals, uvs

    def _ply(self, parameters: Parameters, mapped: bool = False) -> dict[str, Any] | None:
        file = parameters.text("filename")
        if not file:
            raise parameters.fault('the plymesh has no "filename"; give it')
        if parameters.get("displacement") is not None:
            self._staging.note("the displacement of a mesh is left out")
        parameters.ignore("displacement.edgelength", "edgelength")
        line = parameters.values["filename"].line

        def adapted(mesh: MeshData) -> MeshData:
            return faced_by_normals(with_uvs(mesh, _CORNERS) if mapped else mesh)

        found = self._staging.mesh_of_file(file, "ply, mapped" if mapped else "ply", line, adapted)
        return None if found is None else {"type": "mesh", "file": found[0]}

    def _shared(self, name: str, make: Callable[[], MeshData]) -> dict[str, Any]:
        """A mesh that equal shapes share."""
        meshes = self._staging.draft.meshes
        if name not in meshes:
            meshes[name] = make()
        return {"type": "mesh", "file": name}

    def _mesh(self, kind: str, mesh: MeshData) -> dict[str, Any]:
        self._count += 1
        name = f"{kind} {self._count}"
        self._staging.draft.meshes[name] = mesh
        return {"type": "mesh", "file": name}


def _cubics(points: NDArray[np.float64], degree: int, basis: str) -> NDArray[np.float64]:
    """(K, 4, 3) control points of the same curves as cubic Bezier curves."""
    if degree == 3:
        counts = np.array([len(points)], np.int64)
        rows = np.column_stack([points, np.zeros(len(points))])
        return bezier_segments(rows, counts, basis, "curve")[0][..., :3]
    if basis == "bezier":
        a, b, c = points[:-1:2], points[1::2], points[2::2]
    else:
        a, b, c = (points[:-2] + points[1:-1]) / 2.0, points[1:-1], (points[1:-1] + points[2:]) / 2.0
    return np.stack([a, a + (b - a) * (2.0 / 3.0), c + (b - c) * (2.0 / 3.0), c], axis=1)
