"""The shapes of a scene file and their transforms."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias

from pydantic import BeforeValidator, FailFast, Field, Strict, model_validator

from clrender.meshes.data import COORDINATE_LIMIT
from clrender.meshes.vertex_colors import VertexColors
from clrender.scene.poses import MeshPose, Motion, Poses, Transform
from clrender.scene.textures import ColorOrTexture
from clrender.scene.values import (
    INLINE_LIMIT,
    FileName,
    Finite,
    Flag,
    LayerName,
    Length,
    Lengths,
    Name,
    Part,
    Share,
    Vector,
    cross,
    fault,
    length,
)
from clrender.wording import counted

__all__ = [
    "AnyShape",
    "Box",
    "Curves",
    "Disk",
    "Mesh",
    "Quad",
    "Shape",
    "Sphere",
    "Surface",
    "Tetrahedron",
    "Transform",
    "Triangle",
]

_UNEVEN: Final = (
    "stretches a sphere, disk or curve unevenly, which is not supported; scale all axes alike or use a mesh"
)


class Surface(Part):
    """What every shape has."""

    late_keys: ClassVar[frozenset[str]] = frozenset({"visible_to_camera", "shadow_catcher", "light_group", "motion"})
    needs_similarity: ClassVar[bool] = False
    """Whether its transform may not stretch it more along one direction than along others."""
    material: Name | None = Field(None, description="name of the material; without one the shape is black")
    emission: ColorOrTexture | None = Field(
        None, description="emitted radiance, W/(sr m2), constant or a texture; makes the shape an area light"
    )
    interior: Name | None = Field(
        None,
        description="name of the medium inside the closed shape; without a material the surface is invisible",
    )
    name: Name | None = Field(None, description="name in Cryptomatte layers; several shapes may have the same name")
    category: Name | None = Field(None, description="what it is, such as chair, for the layer of categories")
    light_group: LayerName | None = Field(None, description="group of its light, for layers of light groups")
    visible_to_camera: Flag = Field(True, description="false: rays of the camera pass it; all others meet it")
    shadow_catcher: Flag = Field(
        False,
        description="true: for compositing; the camera sees no surface there, and alpha has the shadows on it",
    )
    flip_normals: Flag = False
    transform: Transform = Transform()
    motion: Motion = Field((), description="keys of a motion, which acts after the transform; times ascend")

    @property
    def shines(self) -> bool:
        """Whether it has emission of its own; a texture counts as emission."""
        return self.emission is not None and not (isinstance(self.emission, tuple) and max(self.emission) == 0.0)

    @model_validator(mode="after")
    def _transform_fits(self) -> Surface:
        if self.needs_similarity and not self.transform.is_similarity():
            where = "scale" if self.transform.matrix is None else "matrix"
            raise fault(
                "transform",
                _UNEVEN,
                "transform",
                where,
            )
        for index, key in enumerate(self.motion if self.needs_similarity else ()):
            if not key.is_similarity():
                where = "scale" if key.matrix is None else "matrix"
                raise fault("motion", _UNEVEN, "motion", index, where)
        return self


class Sphere(Surface):
    """Sphere; the front side is outside."""

    needs_similarity: ClassVar[bool] = True
    type: Literal["sphere"]
    center: Vector = (0.0, 0.0, 0.0)
    radius: Length


class Disk(Surface):
    """Disk; its front side faces in the direction of `normal`."""

    needs_similarity: ClassVar[bool] = True
    type: Literal["disk"]
    center: Vector = (0.0, 0.0, 0.0)
    normal: Vector
    radius: Length

    @model_validator(mode="after")
    def _has_a_normal(self) -> Disk:
        if length(self.normal) == 0.0:
            raise fault("disk", "has length zero; give a direction such as [0, 1, 0]", "normal")
        return self


class Quad(Surface):
    """Parallelogram; its normal is edge_u x edge_v."""

    type: Literal["quad"]
    origin: Vector
    edge_u: Vector
    edge_v: Vector


class Triangle(Surface):
    """Triangle; its normal is (v1 - v0) x (v2 - v0)."""

    type: Literal["triangle"]
    vertices: tuple[Vector, Vector, Vector]


class Box(Surface):
    """Axis-aligned box, before the transform; normals point outward."""

    type: Literal["box"]
    center: Vector = (0.0, 0.0, 0.0)
    size: Lengths


class Tetrahedron(Surface):
    """Tetrahedron; normals point outward, regardless of the order of the vertices."""

    type: Literal["tetrahedron"]
    vertices: tuple[Vector, Vector, Vector, Vector]

    @model_validator(mode="after")
    def _has_a_volume(self) -> Tetrahedron:
        first, *others = self.vertices
        a, b, c = ((v[0] - first[0], v[1] - first[1], v[2] - first[2]) for v in others)
        normal = cross(b, c)
        volume = a[0] * normal[0] + a[1] * normal[1] + a[2] * normal[2]
        if abs(volume) <= 1e-7 * length(a) * length(b) * length(c):
            raise fault(
                "tetrahedron", "is degenerate: its vertices lie flat in a plane; move one out of it", "vertices"
            )
        return self


_VertexColor: TypeAlias = tuple[Share, Share, Share]
_Corner = Annotated[int, Strict(), Field(ge=0, lt=2**31)]


_Uv = tuple[Annotated[Finite, Field(ge=-1e6, le=1e6)], Annotated[Finite, Field(ge=-1e6, le=1e6)]]


class Mesh(Surface):
    """Triangle mesh from a file (.ply, .ply.gz, .obj, .stl), or inline as vertices and faces."""

    late_keys: ClassVar[frozenset[str]] = Surface.late_keys | {"shadow_terminator_offset", "poses", "smooth_angle"}

    type: Literal["mesh"]
    file: FileName | None = None
    vertices: Annotated[tuple[Vector, ...], FailFast(), Field(max_length=INLINE_LIMIT)] = ()
    faces: Annotated[tuple[tuple[_Corner, _Corner, _Corner], ...], FailFast(), Field(max_length=INLINE_LIMIT)] = ()
    uvs: Annotated[tuple[_Uv, ...], FailFast(), Field(max_length=INLINE_LIMIT)] = Field(
        (), description="texture coordinates per vertex"
    )
    uvs_1: Annotated[tuple[_Uv, ...], FailFast(), Field(max_length=INLINE_LIMIT)] = Field(
        (), description="second set of texture coordinates"
    )

    colors: Annotated[tuple[_VertexColor, ...], FailFast(), Field(max_length=INLINE_LIMIT)] = Field(
        (), description="linear colour per vertex; multiplies the colour of the material"
    )
    vertex_colors: VertexColors | None = Field(
        None, description="multiply the material's colour by the vertex colours of the file, which have this encoding"
    )
    shadow_terminator_offset: Flag = Field(
        False,
        description="light an opaque mesh with vertex normals as the curved surface that they stand for (Hanika 2021)",
    )

    smooth_angle: Annotated[Finite, Field(gt=0.0, le=180.0)] | None = Field(
        None,
        description="degrees; shade faces that meet at no more as one curved surface, in place of the file's normals",
    )

    poses: Poses = Field((), description="where its vertices are at several times; times ascend")

    def posed(self, number: int) -> Mesh:
        """A mesh of the vertices of one of its poses."""
        pose: MeshPose = self.poses[number]
        if self.file is None:
            return self.with_checked(vertices=pose.vertices, poses=())
        return self.with_checked(file=pose.file, vertex_colors=None, poses=())

    @property
    def asset(self) -> tuple[str, VertexColors | None]:
        """File name, and encoding of the vertex colours that are read."""
        assert self.file is not None
        return self.file, self.vertex_colors

    @property
    def color_key(self) -> str | None:
        """The key that gives it vertex colours, if any."""
        return "vertex_colors" if self.vertex_colors else "colors" if self.colors else None

    @model_validator(mode="after")
    def _has_poses_of_its_kind(self) -> Mesh:
        if self.poses and self.smooth_angle is not None:
            text = "is for meshes that keep their form, as angles between faces change; leave it out"
            raise fault("mesh", text, "smooth_angle")
        for number, pose in enumerate(self.poses):
            if (pose.file is None) != (self.file is None):
                key = "file" if self.file is not None else "vertices"
                raise fault("mesh", f"needs `{key}`, as the mesh itself has", "poses", number)
            if self.file is None and len(pose.vertices) != len(self.vertices):
                text = (
                    f"has {counted(len(pose.vertices), 'entry', 'entries')}, but the mesh has "
                    f"{counted(len(self.vertices), 'vertex', 'vertices')}"
                )
                raise fault("mesh", text, "poses", number, "vertices")
        return self

    @model_validator(mode="after")
    def _has_one_source(self) -> Mesh:
        given = self.model_fields_set & {"vertices", "faces", "uvs", "uvs_1", "colors"}
        if self.file is None and self.vertex_colors is not None:
            raise fault("mesh", "is for a `file`; an inline mesh has `colors`, which need no more", "vertex_colors")
        if self.file is not None:
            for key in sorted(given):
                raise fault("mesh", "cannot be given together with `file`; keep one of them", key)
            return self
        if not given:
            raise fault("mesh", "needs either `file` or both `vertices` and `faces`")
        for key, least in (("vertices", 3), ("faces", 1)):
            if key not in given:
                raise fault("mesh", f"has no `{key}`; an inline mesh needs both `vertices` and `faces`")
            if len(getattr(self, key)) < least:
                raise fault(
                    "mesh",
                    f"has {counted(len(getattr(self, key)), 'entry', 'entries')}, but at least {least} are needed",
                    key,
                )
        for i, face in enumerate(self.faces):
            for j, corner in enumerate(face):
                if corner >= len(self.vertices):
                    text = f"is {corner}, but the mesh has only the vertices 0 to {len(self.vertices) - 1}"
                    raise fault("mesh", text, "faces", i, j)
        for key in ("uvs", "uvs_1", "colors"):
            if getattr(self, key) and len(getattr(self, key)) != len(self.vertices):
                text = (
                    f"has {counted(len(getattr(self, key)), 'entry', 'entries')}, but the mesh has "
                    f"{counted(len(self.vertices), 'vertex', 'vertices')}"
                )
                raise fault("mesh", text, key)
        return self


_Radius = Annotated[Finite, Field(ge=0.0, le=COORDINATE_LIMIT)]


def _radii(value: Any) -> Any:
    """Accepts one number for all points."""
    return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


class Curves(Surface):
    """Strands of hair, grass or thread: tubes or flat ribbons along cubic curves."""

    needs_similarity: ClassVar[bool] = True

    type: Literal["curves"]
    file: FileName | None = Field(None, description=".npy or .txt with the control points of all strands")
    points: Annotated[tuple[Vector, ...], FailFast(), Field(max_length=INLINE_LIMIT)] = Field(
        (), description="control points, one strand after the other"
    )
    counts: Annotated[tuple[Annotated[int, Strict(), Field(gt=0)], ...], FailFast(), Field(max_length=INLINE_LIMIT)] = (
        Field((), description="number of control points of each strand; default: all are one strand")
    )
    radius: Annotated[
        Annotated[tuple[_Radius, ...], FailFast(), Field(max_length=INLINE_LIMIT)], BeforeValidator(_radii)
    ] = Field(
        (),
        description="radius of the tubes, or half the width of the ribbons: one number, two for roots and tips, or one "
        "for each control point",
        json_schema_extra={"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}}]},
    )
    basis: Literal["bspline", "bezier", "catmull-rom", "linear"] = Field(
        "bspline", description="what curves the control points are of"
    )
    profile: Literal["round", "ribbon"] = Field(
        "round", description="cross section; ribbons are flat and have two sides"
    )
    normals: Annotated[tuple[Vector, ...], FailFast(), Field(max_length=INLINE_LIMIT)] = Field(
        (),
        description="where ribbons face: one vector, or one for each control point; default: of the file, or as they "
        "turn least",
    )

    @model_validator(mode="after")
    def _has_strands(self) -> Curves:
        if (self.file is None) == (not self.points):
            raise fault("curves", "needs either `file` or `points`, and not both", "file" if self.file else "points")
        if self.file is not None and self.counts:
            raise fault("curves", "is for `points`; a file has its own strands", "counts")
        if self.counts and sum(self.counts) != len(self.points):
            text = f"add up to {sum(self.counts)}, but the curves have {counted(len(self.points), 'point')}"
            raise fault("curves", text, "counts")
        if self.file is None and not self.radius:
            raise fault("curves", "is missing; give a number of metres", "radius")
        if self.file is None and len(self.radius) not in (1, 2, len(self.points)):
            text = (
                f"has {counted(len(self.radius), 'entry', 'entries')}; give one, two for roots and tips, or "
                f"{len(self.points)}"
            )
            raise fault("curves", text, "radius")
        if self.radius and max(self.radius) == 0.0:
            raise fault("curves", "is 0, which nothing can be seen of; give a number of metres", "radius")
        if self.normals and self.profile == "round":
            raise fault("curves", 'are for ribbons; give profile = "ribbon", or leave them out', "normals")
        for index, normal in enumerate(self.normals):
            if not any(normal):
                raise fault("curves", "is zero, which has no direction", "normals", index)
        if self.file is None and len(self.normals) not in (0, 1, len(self.points)):
            text = f"has {counted(len(self.normals), 'entry', 'entries')}; give one, or {len(self.points)}"
            raise fault("curves", text, "normals")
        if self.emission is not None:
            raise fault("curves", "is not for curves, which cannot shine; leave it out", "emission")
        if self.interior is not None:
            raise fault("curves", "is not for curves, which have no inside; leave it out", "interior")
        if self.flip_normals:
            raise fault("curves", "is not for curves, which have no inside; leave it out", "flip_normals")
        return self


AnyShape: TypeAlias = Sphere | Quad | Triangle | Box | Tetrahedron | Disk | Mesh | Curves
Shape: TypeAlias = Annotated[AnyShape, Field(discriminator="type")]
