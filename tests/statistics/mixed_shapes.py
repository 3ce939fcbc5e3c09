"""The things that stand in mixed scenes: shapes of all types with random materials, alone or as instances of groups."""

from __future__ import annotations

from collections.abc import Iterator

from mixed_files import SMOOTH_MESHES
from mixed_parts import Draw, Json, emission_for_white, material, medium

__all__ = ["Things"]

_OPEN = ("quad", "triangle", "disk", "mesh")
_CLOSED = ("sphere", "box", "tetrahedron", "mesh", "block", "smooth")
_COLORED = ("lambert", "mirror", "oren_nayar", "principled")


class Things:
    """Shapes with the materials, media and groups that they name.

    Volumes that refract keep to two places: those with a priority to the right of the middle, those without one to the
    left. Where both kinds overlap, the documentation asks for priorities.

    Parameters
    ----------
    draw : Draw
    media : bool
        Whether there may be scattering media and subsurface materials.
    solids : bool
        Whether light may enter any of them.
    """

    def __init__(self, draw: Draw, media: bool, solids: bool) -> None:
        self.draw = draw
        self.may_scatter, self.may_enter = media, solids
        self.materials: Json = {}
        self.media: Json = {}
        self.groups: Json = {}
        self.shapes: list[Json] = []

    def add(self, reach: float = 0.8, least: float = 0.2, most: float = 0.6) -> None:
        """Add a thing of this size with a random material, or a volume without one."""
        draw = self.draw
        if self.may_scatter and draw.chance(0.15):
            shape = self._form(True, draw.point(1.5 * reach), draw.between(least, 2.0 * most), frozenset())
            self.shapes.append(self._placed({**shape, "interior": self.medium()}))
            return
        name = self.material()
        made = self.materials[name]
        ranked = made.get("priority") is not None
        center = draw.point(reach)
        refracts = self._refracts(name)
        if refracts:
            center = [(1.35 if ranked else -1.35) + draw.between(-0.5, 0.5), *center[1:]]
            most = min(most, 0.5)
        solid = self._solid(made)
        opaque = self._opaque(name)
        coordinates = frozenset(self._coordinates(name))
        shape = self._form(solid or refracts, center, draw.between(least, most), coordinates, opaque)
        shape["material"] = name
        if opaque and shape.get("file") in SMOOTH_MESHES and (draw.white or draw.chance(0.5)):
            shape["shadow_terminator_offset"] = True
        if (
            shape.get("file") in SMOOTH_MESHES and len(self.shapes) >= 4
        ):  # without a draw, which would change what follows
            shape["smooth_angle"] = 60.0
        if solid and made["type"] != "subsurface" and "attenuation_color" not in made and self.may_scatter:
            shape |= {"interior": self.medium()} if draw.chance(0.4) else {}
        if self.colorable(name) and shape["type"] == "mesh":
            self._color(shape)
        if not (solid or refracts):
            shape |= {"flip_normals": True} if draw.chance(0.2) else {}
        if not solid and draw.chance(0.1):
            # Without a draw, which would change all that follows
            catches = not draw.white and "emission" not in made and len(self.shapes) % 5 < 2
            shape |= {"shadow_catcher": True} if catches else {"visible_to_camera": False}
        shape |= {"name": name} if draw.chance(0.1) else {}
        self.shapes.append(self._placed(shape))

    def medium(self) -> str:
        """Name of a new medium."""
        name = f"medium {len(self.media)}"
        self.media[name] = medium(self.draw)
        return name

    def material(self, kind: str | None = None, part: bool = False) -> str:
        """Name of a new material, of this type or any; for a part of a mixture if asked for."""
        made = material(self.draw, kind)
        if part:
            while made["type"] == "subsurface" or "opacity" in made or "emission" in made:
                made = material(self.draw, kind)
        if not self.may_scatter and made["type"] == "subsurface":
            return self.material("oren_nayar", part)
        if not self.may_enter and self._solid(made):
            return self.material("conductor", part)
        if made["type"] == "mix":
            first = self.material(part=True)
            # Through two kinds of glass light could get in by one and out by the other
            entered = self._refracts(first) or self._solid(self.materials[first])
            made["materials"] = [first, self.material("lambert" if entered else None, part=True)]
            if self._refracts(made["materials"][1]) or entered:
                made.pop("opacity", None)
                made.pop("opacity_cutoff", None)
        if part and made.get("priority") is not None:
            del made["priority"]
        if made["type"] == "principled" and self._solid(made) and self.draw.white:
            made.pop("normal_map", None)
        name = f"{made['type']} {len(self.materials)}"
        self.materials[name] = made
        return name

    def flat_material(self, *kinds: str) -> str:
        """Name of a new material of one of these types that needs no second set of texture coordinates."""
        name = self.material(self.draw.one(kinds))
        while 1 in self._coordinates(name):
            name = self.material(self.draw.one(kinds))
        return name

    def shining(self, reach: float, white: bool) -> None:
        """Add a shape with emission; in a white scene it emits what it does not reflect."""
        draw = self.draw
        name = f"lambert {len(self.materials)}"
        if white:
            reflectance, emission = emission_for_white(draw)
            self.materials[name] = {"type": "lambert", "reflectance": reflectance}
        else:
            name = self.material(draw.one(("lambert", "oren_nayar", "conductor")))
            picture = {"texture": "colors.png", "scale": draw.between(1.0, 4.0)}
            made = {draw.one(("checker", "ramp")): [draw.color(0.5, 3.0), draw.between(0.5, 3.0)]}
            emission = draw.one((draw.color(0.5, 3.0), picture, made))
        shape = self._form(
            white or draw.chance(0.5),
            draw.point(reach),
            draw.between(0.3, 0.7),
            frozenset({0, *self._coordinates(name)}),
        )
        shape |= {"emission": emission} | ({"material": name} if white or draw.chance(0.7) else {})
        if shape["type"] == "sphere" and not white and len(self.shapes) % 2:  # without a draw
            shape["flip_normals"] = True
            if "material" in shape:
                self.materials[name] |= {"opacity": 0.5}
        self.shapes.append(shape)

    def colorable(self, name: str) -> bool:
        """Whether the material has a colour that vertex colours may multiply."""
        made = self.materials[name]
        if made["type"] == "mix":
            return all(self.colorable(part) for part in made["materials"])
        return made["type"] in _COLORED or "f0" in made

    def _color(self, shape: Json) -> None:
        draw = self.draw
        if "file" not in shape:
            if draw.chance(0.5):
                shape["colors"] = [[1.0] * 3 if draw.white else draw.color(0.4, 1.0) for _ in shape["vertices"]]
        elif shape["file"] == "smooth.ply" and not draw.white and draw.chance(0.6):
            shape["vertex_colors"] = draw.one(("auto", "srgb", "linear"))

    @staticmethod
    def _solid(made: Json) -> bool:
        """Whether light passes through it into a medium."""
        if made["type"] == "dielectric":
            return not made.get("thin", False)
        return made["type"] == "subsurface" or (made.get("transmission", 0.0) != 0.0 and not made.get("thin", False))

    def _refracts(self, name: str) -> bool:
        made = self.materials[name]
        if made["type"] == "mix":
            return any(self._refracts(part) for part in made["materials"])
        return self._solid(made)

    def _coordinates(self, name: str) -> Iterator[int]:
        """The sets of texture coordinates that it reads."""
        made = self.materials[name]
        for part in made.get("materials", ()):
            yield from self._coordinates(part)
        for value in made.values():
            if isinstance(value, dict):
                yield value.get("uv_set", 0)

    def _opaque(self, name: str) -> bool:
        """Whether it neither shines nor lets light in, so that its mesh may stand for a curved surface."""
        made = self.materials[name]
        if made["type"] == "mix":
            return all(self._opaque(part) for part in made["materials"])
        lets_in = {"transmission", "diffuse_transmission", "emission"}
        return made["type"] not in ("dielectric", "subsurface") and not lets_in & made.keys()

    def _form(
        self, closed: bool, center: list[float], size: float, coordinates: frozenset[int], opaque: bool = False
    ) -> Json:
        """A shape without material, whose middle and half size are these."""
        draw = self.draw
        kinds: tuple[str, ...] = _CLOSED if closed or draw.chance(0.5) else _OPEN
        if draw.white and not opaque:
            kinds = tuple(kind for kind in kinds if kind != "smooth")
        if coordinates:
            kinds = tuple(kind for kind in kinds if kind != "block")
        if 1 in coordinates:
            kinds = ("mesh",)
        kind = draw.one(kinds)
        x, y, z = center
        shape: Json = {"type": kind}
        if kind in ("sphere", "disk"):
            shape |= {"center": center, "radius": size} | ({"normal": draw.direction()} if kind == "disk" else {})
        elif kind == "box":
            shape |= {"center": center, "size": [2.0 * size * draw.between(0.5, 1.0) for _ in range(3)]}
        elif kind == "quad":
            u, v = [2.0 * size, 0.0, draw.between(-size, size)], [draw.between(-size, size), 2.0 * size, 0.0]
            shape |= {"origin": [x - size, y - size, z], "edge_u": u, "edge_v": v}
        elif kind == "triangle":
            shape["vertices"] = [[x - size, y, z], [x + size, y - size, z], [x, y + size, z + draw.between(-1, 1)]]
        elif kind == "tetrahedron":
            corners = ((-1, -1, -1), (1, 1, -1), (1, -1, 1), (-1, 1, 1))
            shape["vertices"] = [[x + size * a, y + size * b, z + size * c] for a, b, c in corners]
        elif kind == "mesh":
            shape |= self._octahedron(center, size, closed, coordinates)
        else:
            file = "block.stl" if kind == "block" else draw.one(SMOOTH_MESHES)
            shape = {"type": "mesh", "file": file, "transform": {"scale": size, "translate": center}}
            if draw.chance(0.5):
                shape["transform"]["rotate_degrees"] = [draw.between(-180, 180) for _ in range(3)]
            return shape
        if draw.chance(0.3):
            shape["transform"] = self._turned()
        return shape

    def _octahedron(self, center: list[float], size: float, closed: bool, coordinates: frozenset[int]) -> Json:
        x, y, z = center
        steps = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
        faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
        made: Json = {
            "vertices": [[x + size * a, y + size * b, z + size * c] for a, b, c in steps],
            "faces": faces if closed else faces[: self.draw.count(3, 7)],
        }
        for number, key in enumerate(("uvs", "uvs_1")):
            if number in coordinates:
                made[key] = [[self.draw.between(0.0, 1.5), self.draw.between(0.0, 1.5)] for _ in steps]
        return made

    def _turned(self) -> Json:
        """A transform that keeps spheres spheres, and things about where they are."""
        if self.draw.chance(0.3):
            a, b = self.draw.one(((0.6, 0.8), (-0.28, 0.96)))
            return {"matrix": [[a, -b, 0.0, 0.0], [b, a, 0.0, 0.05], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]}
        made: Json = {"rotate_degrees": [self.draw.between(-20, 20) for _ in range(3)]}
        return made | self.draw.one(({}, {"scale": 0.9}, {"scale": [0.9, -0.9, 0.9]}, {"translate": [0.0, 0.1, 0.0]}))

    def _placed(self, shape: Json) -> Json:
        """The shape itself, or an instance of a group of it."""
        draw = self.draw
        if draw.chance(0.7):
            return shape
        name = f"group {len(self.groups)}"
        refracts = "material" in shape and self._refracts(shape["material"])
        self.groups[name] = {"shapes": [shape]}
        made: Json = {"type": "instance", "group": name, **draw.one(({}, {"name": name}))}
        how = draw.one(("transform", "transforms", "file"))
        if how == "file" and not refracts and shape["type"] not in ("sphere", "disk"):
            return {**made, "transforms": "places.npy"}
        sides = [draw.between(0.5, 1.0) for _ in range(3)]
        if shape["type"] in ("sphere", "disk"):  # stay what they are
            return {
                **made,
                "transform": {"scale": draw.one((0.8, [-0.7, 0.7, 0.7])), "rotate_degrees": draw.color(-9.0, 9.0)},
            }
        if how == "transforms":
            first = [
                [sides[0], 0.1, 0.0, 0.0],
                [0.0, -sides[1], 0.1, 0.0],
                [0.0, 0.0, sides[2], 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ]
            second = [
                [sides[0], 0.0, 0.0, 0.0],
                [0.0, sides[2], 0.0, 0.3],
                [0.1, 0.0, sides[1], 0.4],
                [0.0, 0.0, 0.0, 1.0],
            ]
            return {**made, "transforms": draw.one(([first], [second, first]))}
        return {
            **made,
            "transform": {
                "scale": draw.one((sides, [-sides[0], *sides[1:]])),
                **draw.one(({}, {"rotate_degrees": [5.0, 0.0, 10.0]})),
            },
        }
