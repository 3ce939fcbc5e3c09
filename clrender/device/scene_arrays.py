"""Uploads a flat scene to a device: rows for shading and the BVH, in the order of the kernels' parameters."""

from __future__ import annotations

import re
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.device import bvh
from clrender.device.scene_trees import SceneTrees, masked_primitives
from clrender.errors import MemoryRefused, RenderError
from clrender.files.package_data import kernels_folder
from clrender.flatten.chains import chain_table
from clrender.flatten.spectral import spectral_arrays
from clrender.process.memory import shown
from clrender.wording import counted

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Mapping

    from clrender.device.device import Buffer, Device
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["LARGEST_PAGE", "SceneArrays", "check_room", "scene_array_names", "texel_pages"]

_MANY_PRIMITIVES: Final = 1 << 17
"""From so many on, a BVH is built faster by fast code, its compilation included."""

LARGEST_PAGE = 1 << 34
"""Most bytes of a buffer of texels: where all are in one, kernels count its words in 32 bits (texture/texel.h)."""
_PAGES = 4
_AS_THEY_ARE = (
    *("material_rows", "media_rows", "albedo_tables", "light_nodes", "light_order", "environment_map"),
    *("light_cones", "lamp_tables", "grid_rows", "measured_rows", "thin_film_rows", "curve_rows"),
    *("instance_rows", "instance_guides", "instance_motions", "motion_rows"),
    *("hole_rows", "attribute_rows", "texture_rows", "texture_slots", "texel_values"),
)
"""Host arrays that the kernels read unchanged."""
_SHARED = ("texels", "grid_words", "measured_words")
"""Large ones among them, which a device that can access host memory need not copy."""
_ROWS_OF = {
    "primitive_rows": ("vertices", "triangles", "analytic_shapes", "primitive_shape", "shapes", "materials"),
    "normal_rows": ("normals", "vertices", "triangles"),
}
"""Host arrays that rows are computed from."""
_WORTH_LENDING = 1 << 16
"""Least bytes of an array that another scene with the same array takes over."""
_TREE = ("nodes", "triangle_packs", "analytic_packs")
_MOST_COST = 1.5
"""How much more a refitted BVH may cost than one that was built: rays take about as much longer."""
_NO_ROW = np.zeros(16, np.float32)
_FIRST_ROWS = 1024
"""Least bytes of an array. Lanes that have nothing to look up read its first rows, whether the scene has any or not."""


@cache
def scene_array_names() -> tuple[str, ...]:
    """Names in the list of ``kernels/scene.h``, in order: the first parameters of every rendering kernel."""
    text = (kernels_folder() / "scene.h").read_text(encoding="utf-8")
    block = text[text.index("#define SCENE_ARRAYS(X)") : text.index("#define SCENE_MEMBER_")]
    return tuple(re.findall(r"X\(\w+, (\w+)\)", block))


def texel_pages(device: Device, texels: NDArray[np.uint8]) -> tuple[list[Buffer], int | None]:
    """Upload texels, to as few of four buffers as the largest buffer size allows.

    Parameters
    ----------
    device : Device
    texels : (tiles, 64) uint8
        If the device can access host memory, they are not copied.

    Returns
    -------
    pages : list of four Buffer
        Unused ones are the first again.
    bits : int or None
        Binary logarithm of the number of tiles per page; None if one page holds all.

    Raises
    ------
    RenderError
        When they do not fit into four pages, or the device lacks the memory.
    """
    largest = min(device.max_allocation_bytes, LARGEST_PAGE) // texels.shape[1]
    if len(texels) <= largest:
        return [device.share(texels)] * 4, None
    bits = max(largest, 1).bit_length() - 1
    count = -(-len(texels) >> bits)
    if count > _PAGES:
        raise RenderError(
            f"{device.info.title} takes {counted(_PAGES * 64 << bits, 'byte')} of textures, but the scene has "
            f"{texels.nbytes}; "
            "use smaller pictures, or another device"
        )
    pages = [device.share(texels[page << bits : (page + 1) << bits]) for page in range(count)]
    return [*pages, *[pages[0]] * (_PAGES - count)], bits


_FEWER_TRIANGLES: Final = "take a scene of fewer triangles (groups that are placed many times take their memory once)"
_CURES: Final = {
    "grid_words": "make the grids of its media coarser",
    "measured_words": "use fewer measured materials",
}
"""What helps where an array is too large, if it is not fewer triangles."""
_TREE_BYTES = 32
"""Least number of bytes per triangle in a BVH: half of a column of a pack, which two triangles may share."""


def check_room(device: Device, scene: FlatScene) -> None:
    """Refuse a scene that does not fit on a device, before anything is uploaded.

    Parameters
    ----------
    device : Device
    scene : FlatScene
        The size of its BVHs is not known yet, so a scene that passes may still be refused when they are built.

    Raises
    ------
    RenderError
        When an array is larger than the device's largest buffer, or the whole scene is larger than its memory.
    MemoryRefused
        When the scene exceeds the memory limit.
    """
    triangles, primitives = scene.triangle_count, scene.triangle_count + scene.analytic_count
    sizes = {name: array.nbytes for name, array in scene.arrays.items() if name != "texels"}
    sizes |= {"primitive_rows": 64 * primitives, "triangle_packs": _TREE_BYTES * triangles}
    sizes["normal_rows"] = 64 * triangles if len(scene.arrays["normals"]) > 1 else 0
    name, most = max(sizes.items(), key=lambda item: item[1])
    if most > device.max_allocation_bytes:
        raise RenderError(
            f"the scene is too large for {device.info.title}: its {name.replace('_', ' ')} take {shown(most)}, "
            f"{shown(most - device.max_allocation_bytes)} more than the {shown(device.max_allocation_bytes)} that the "
            f"device allows in one buffer; {_CURES.get(name, _FEWER_TRIANGLES)}, or another device"
        )
    total = sum(sizes.values()) + scene.arrays["texels"].nbytes
    if total > device.free_bytes:
        raise MemoryRefused(
            f"the scene takes {shown(total)} and more on {device.info.title}, where {shown(device.free_bytes)} of what "
            "--max-memory (max_memory) allows are left; allow more, take a smaller scene, or another device"
        )
    if total > device.info.memory_bytes > 0:
        raise RenderError(
            f"the scene takes {shown(total)} and more, and {device.info.title} has "
            f"{shown(device.info.memory_bytes)} of memory; take a smaller scene, or another device"
        )


class SceneArrays:
    """A scene on one device.

    Parameters
    ----------
    device : Device
    scene : FlatScene
    tree : bvh.Bvh, optional
        BVH to use instead of one over the whole scene; the caller still owns it.
    apart : (S,) bool, optional
        Shapes whose triangles are each by itself in the BVH, also where two are a parallelogram.
    earlier : SceneTrees, optional
        BVHs of another scene, which the caller owns: what is the same goes on with them.
    lent : mapping of str to Buffer, optional
        What `lent_to` of another scene's arrays gave; these arrays own it then.

    Attributes
    ----------
    buffers : dict of str to Buffer
        By the names of ``kernels/scene.h``, except ``settings``, which belongs to a render.
    tree : bvh.Bvh
        BVH over all opaque primitives.
    masked_tree : bvh.Bvh or None
        BVH over all masked primitives.
    page_bits : int or None
        See `texel_pages`.
    apart : (S,) bool
        Shapes that are to be `apart` in a BVH that is to be refitted: also those whose parallelograms `refit` found to
        be none any more.
    rates : dict of (str, bytes) to float
        Samples a second that were last traced, by kernel file and settings.

    Raises
    ------
    RenderError
        When the device lacks the memory.
    """

    def __init__(
        self,
        device: Device,
        scene: FlatScene,
        tree: bvh.Bvh | None = None,
        apart: NDArray[np.bool_] | None = None,
        earlier: SceneTrees | None = None,
        lent: Mapping[str, Buffer] = MappingProxyType({}),
    ) -> None:
        check_room(device, scene)
        self._device = device
        self._scene = scene
        self._chains: Buffer | None = None
        self._spectral: dict[str, Buffer] = {}
        self._seen: tuple[tuple[int, int] | None, bytes | None] = None, None
        self.rates: dict[tuple[str, bytes], float] = {}
        triangles, primitives = scene.triangle_count, scene.triangle_count + scene.analytic_count
        device.common_program(large=primitives > _MANY_PRIMITIVES)
        arrays = self._given(scene, [name for name in scene.arrays if name not in (*_SHARED, *lent)])
        arrays |= {name: lent[name] for name in _AS_THEY_ARE if name in lent}
        source = _source(arrays, scene)
        units = bvh.triangle_units(device, source)
        alone = scene.deforming_shapes if apart is None else scene.deforming_shapes | apart
        if alone.any():
            units = bvh.unpaired(units, alone[scene.arrays["primitive_shape"][units & bvh.UNIT_NUMBER]])
        self.apart = np.zeros(len(scene.arrays["shapes"]), bool) if apart is None else apart
        self._pairs = units[(units & bvh.UNIT_PAIR) != 0]
        self._built_cost: float | None = None
        self._own_trees: SceneTrees | None = None
        if tree is None:
            trees = self._own_trees = SceneTrees(device, source, units, scene, arrays["instance_rows"], earlier)
            self.tree, self.masked_tree = trees.opaque, trees.masked
        else:
            self.tree, self.masked_tree = tree, None
        if "texels" in lent:
            pages, self.page_bits = [lent["texels"]] * _PAGES, None
        else:
            pages, self.page_bits = texel_pages(device, scene.arrays["texels"])
        smooth = len(scene.arrays["normals"]) > 1
        made = {name: lent[name] for name in _ROWS_OF if name in lent}
        if "primitive_rows" not in made:
            # Lanes without a hit read row 0, so it must exist.
            made["primitive_rows"] = device.empty(64 * primitives) if primitives else device.upload(_NO_ROW)
        if "normal_rows" not in made:
            made["normal_rows"] = device.empty(64 * (max(triangles, 1) if smooth else 1))
        self.buffers: dict[str, Buffer] = {
            **made,
            "light_rows": device.empty(64 * len(scene.arrays["lights"])),
            "light_alias": device.empty(8 * len(scene.arrays["lights"])),
            **{name: arrays.pop(name) for name in _AS_THEY_ARE},
            **{f"texels_{number}": page for number, page in enumerate(pages)},
            **{
                name: lent[name] if name in lent else device.share(_with_first_rows(scene.arrays[name]))
                for name in _SHARED
                if name != "texels"
            },
            **dict(zip(_TREE, self.tree.buffers, strict=True)),
            **dict(zip((f"masked_{name}" for name in _TREE), (self.masked_tree or self.tree).buffers, strict=True)),
            "camera": device.upload(scene.camera),
            "camera_knots": device.upload(scene.camera_knots),
        }
        self.buffers["chain_table"] = self.buffers["light_alias"]  # a substitute, which no kernel without chains reads
        self.buffers["spectra"] = self.buffers["light_alias"]  # likewise, without wavelengths
        self._compute_rows(scene, arrays, self.buffers, lent)
        for buffer in arrays.values():
            device.release(buffer)

    def rates_for(self, scene: FlatScene) -> dict[tuple[str, bytes], float]:
        """The rates that another scene may be expected to have, as the next one of an animation; else none.

        Parameters
        ----------
        scene : FlatScene
        """
        old = self._scene
        counts = [(each.triangle_count, each.analytic_count, each.light_count) for each in (old, scene)]
        return dict(self.rates) if counts[0] == counts[1] and old.features == scene.features else {}

    def lent_to(self, scene: FlatScene) -> dict[str, Buffer]:
        """Buffers of large arrays that another scene has too, which the caller owns; these arrays are to be released.

        Parameters
        ----------
        scene : FlatScene

        Returns
        -------
        dict of str to Buffer
            By the names of `buffers`; ``texels`` is all of them.
        """
        if self._device.memory_limit is not None:  # which what is lent would count against twice
            return {}
        old, new = self._scene.arrays, scene.arrays

        def same(name: str) -> bool:
            a, b = old[name], new[name]
            return a is b or (
                a.shape == b.shape and a.dtype == b.dtype and bool(np.array_equal(_bits_of(a), _bits_of(b)))
            )

        lent = {}
        for name in (*_AS_THEY_ARE, *_SHARED, *_ROWS_OF):
            if name == "instance_rows" or (name == "texels" and self.page_bits is not None):
                continue
            buffer = self.buffers["texels_0" if name == "texels" else name]
            if buffer.nbytes >= _WORTH_LENDING and all(same(each) for each in _ROWS_OF.get(name, (name,))):
                lent[name] = buffer
        self.buffers = {name: buffer for name, buffer in self.buffers.items() if buffer not in lent.values()}
        return lent

    def _given(self, scene: FlatScene, names: Iterable[str]) -> dict[str, Buffer]:
        """Arrays of the host on the device; those that only kernels of rows and trees read need not be copied."""
        give = {name: self._device.upload if name in _AS_THEY_ARE else self._device.share for name in names}
        return {name: put(_with_first_rows(scene.arrays[name])) for name, put in give.items()}

    def _compute_rows(
        self,
        scene: FlatScene,
        arrays: Mapping[str, Buffer],
        into: Mapping[str, Buffer],
        there: Container[str] = frozenset(),
    ) -> None:
        """Compute the rows that kernels read, but for those that are there."""
        triangles, count = np.uint32(scene.triangle_count), scene.triangle_count + scene.analytic_count
        geometry: list[Buffer | np.generic] = [arrays[name] for name in ("vertices", "triangles", "analytic_shapes")]
        more: list[Buffer | np.generic] = [arrays[name] for name in ("primitive_shape", "shapes", "materials")]
        rows = into["primitive_rows"]
        if "primitive_rows" not in there:
            self._rows("primitives", count, [*geometry, *more, triangles, np.uint32(count), rows])
        if len(scene.arrays["normals"]) > 1 and "normal_rows" not in there:
            normals: list[Buffer | np.generic] = [arrays["normals"], *geometry[:2], triangles]
            self._rows("normals", scene.triangle_count, [*normals, into["normal_rows"]])
        lights = len(scene.arrays["lights"])
        light_rows = [into["light_rows"], into["light_alias"]]
        self._rows("lights", lights, [arrays["lights"], *geometry, triangles, np.uint32(lights), *light_rows])
        self._device.finish()

    def refit(self, scene: FlatScene) -> bool:
        """Make these arrays those of a scene that differs in places, shading, light or camera, but not in its shapes.

        The BVHs are refitted. Hits are then the same as with BVHs built for this scene, but for the rounding of
        distances.

        Parameters
        ----------
        scene : FlatScene

        Returns
        -------
        bool
            Whether that was done. It is not where arrays would have other sizes, or a triangle other corners, where two
            triangles are no parallelogram any more, or where the BVHs would become much worse. The arrays must not be
            used any more then.

        Raises
        ------
        RenderError
            When the device fails. The arrays must not be used any more.
        """
        if self._own_trees is None or not _same_shapes(self._scene, scene):
            return False
        device = self._device
        kept = {*_SHARED, *_AS_THEY_ARE} - {"curve_rows"}
        arrays = self._given(scene, [name for name in scene.arrays if name not in kept])
        try:
            source = _source(arrays, scene)
            broken = self._pairs[bvh.broken_pairs(device, source, self._pairs)]
            if len(broken):
                self.apart[scene.arrays["primitive_shape"][broken & bvh.UNIT_NUMBER]] = True
                return False
            if self._built_cost is None:
                self._built_cost = sum(bvh.cost(device, tree) for tree in self._trees)
            self._own_trees.forget()
            for tree in self._trees:
                bvh.refit(device, source, tree, scene.instances.boxes)
            if not sum(bvh.cost(device, tree) for tree in self._trees) <= _MOST_COST * self._built_cost:
                return False
            for name in _AS_THEY_ARE:
                if scene.arrays[name].tobytes() != self._scene.arrays[name].tobytes():
                    device.write(self.buffers[name], _with_first_rows(self._with_roots(scene, name)))
            self._compute_rows(scene, arrays, self.buffers)
        finally:
            for buffer in arrays.values():
                device.release(buffer)
        self.look(scene)
        if self._chains is not None:
            device.release(self._chains)
            self._chains = None
        self._forget_spectral()
        self._scene = scene
        return True

    def _with_roots(self, scene: FlatScene, name: str) -> NDArray[Any]:
        """An array of a scene; the rows of instances with the roots of the BVHs of their groups, which stay."""
        array = scene.arrays[name]
        if name != "instance_rows" or not scene.instances.count:
            return array
        kept = np.empty_like(array)
        self._device.read(self.buffers[name], kept)
        rows = array.copy()
        for column in ("ROOT", "MASKED_ROOT"):
            place = layout.columns("INSTANCE")[column]
            rows.view(np.uint32)[::2, place] = kept.view(np.uint32)[::2, place]
        return rows

    def _rows(self, name: str, count: int, arguments: list[Buffer | np.generic]) -> None:
        if count:
            self._device.launch_each(self._device.common_program(), f"rows_{name}", count, arguments)

    def chain_table(self) -> Buffer | None:
        """The table of specular chains (`clrender.flatten.chains`), uploaded at the first call; None if there are none.

        Raises
        ------
        SceneError
            If there are too many surfaces for them.
        """
        if self._chains is None:
            table = chain_table(self._scene)
            if not table[layout.columns("CHAIN_HEAD")["LIGHTS"]].view(np.uint32):
                return None
            self._chains = self._device.upload(table)
        return self._chains

    def spectral(
        self, bands: tuple[int, int] | None = None, film: NDArray[np.float64] | None = None
    ) -> dict[str, Buffer]:
        """Arrays that kernels read in place of others if they render wavelengths, uploaded at the first call.

        Parameters
        ----------
        bands : (int, int), optional
        film : (95, 4) float64, optional
            See `clrender.spectra.kernel_table.kernel_table`. A render with others must have ended.
        """
        seen = bands, None if film is None else film.tobytes()
        if not self._spectral or self._seen != seen:
            self._forget_spectral()
            arrays = spectral_arrays(self._scene.arrays, self._scene.spectral, bands, film)
            self._spectral = {name: self._device.upload(_with_first_rows(array)) for name, array in arrays.items()}
            self._seen = seen
            if "materials" in arrays or "lights" in arrays:
                self._compute_spectral_rows()
        return self._spectral

    def _compute_spectral_rows(self) -> None:
        """Compute the rows of primitives and lights again, with spectra in the place of colours."""
        names = (
            "vertices",
            "triangles",
            "analytic_shapes",
            "primitive_shape",
            "shapes",
            "materials",
            "lights",
            "normals",
        )
        arrays = self._given(self._scene, [name for name in names if name not in self._spectral])
        for name in ("primitive_rows", "light_rows", "light_alias"):
            self._spectral[name] = self._device.empty(self.buffers[name].nbytes)
        self._compute_rows(self._scene, {**arrays, **self._spectral}, {**self.buffers, **self._spectral})
        for buffer in arrays.values():
            self._device.release(buffer)

    @property
    def node_count(self) -> int:
        """Number of nodes of all BVHs."""
        return sum(tree.node_count for tree in self._trees)

    @property
    def tree_bytes(self) -> int:
        """Size of all BVHs, bytes."""
        return sum(tree.nbytes for tree in self._trees)

    @property
    def stack_entries(self) -> int:
        """Capacity that the traversal stack needs for either BVH, in entries."""
        return max(tree.stack_entries for tree in self._trees)

    @property
    def _trees(self) -> list[bvh.Bvh]:
        return [self.tree, self.masked_tree] if self.masked_tree else [self.tree]

    def look(self, scene: FlatScene) -> None:
        """Replace the cameras and their motions by those of a scene that has the same arrays."""
        arrays: dict[str, NDArray[Any]] = {"camera": scene.camera}
        if scene.camera["segments"].any():  # those of cameras at rest are not read
            arrays["camera_knots"] = scene.camera_knots
        for name, array in arrays.items():
            held = self.buffers[name]
            if held.nbytes == array.nbytes:
                self._device.write(held, array)
                continue
            self.buffers[name] = self._device.upload(array)
            self._device.release(held)

    def trees_for(self, scene: FlatScene) -> SceneTrees | None:
        """The BVHs, if another scene can go on with some of them; the caller owns them from then on."""
        if self._own_trees is None or not self._own_trees.shares(scene):
            return None
        trees, self._own_trees = self._own_trees, None
        return trees

    def _forget_spectral(self) -> None:
        for buffer in self._spectral.values():
            self._device.release(buffer)
        self._spectral = {}

    def release(self) -> None:
        """Release the device memory, but for BVHs that are others'."""
        lent = () if self._own_trees else [buffer for tree in self._trees for buffer in tree.buffers]
        if self._chains is not None:
            self._device.release(self._chains)
            self._chains = None
        self._forget_spectral()
        for buffer in dict.fromkeys(self.buffers.values()):  # unused entries are duplicates of others
            if buffer not in lent:
                self._device.release(buffer)
        self.buffers.clear()


def _bits_of(array: NDArray[Any]) -> NDArray[np.uint8]:
    """The bytes of an array, (n,)."""
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8)


def _with_first_rows(array: NDArray[Any]) -> NDArray[Any]:
    """The array, with zeros behind its end up to `_FIRST_ROWS` bytes."""
    lacking = _FIRST_ROWS - array.nbytes
    if lacking <= 0:
        return array
    return np.concatenate([np.ascontiguousarray(array).reshape(-1).view(np.uint8), np.zeros(lacking, np.uint8)])


def _source(arrays: dict[str, Buffer], scene: FlatScene) -> bvh.SourceArrays:
    return bvh.SourceArrays.of(arrays, scene.triangle_count, scene.analytic_count)


def _same_shapes(old: FlatScene, new: FlatScene) -> bool:
    """Whether two scenes have the same triangles between other vertices, and all else in arrays of the same sizes."""
    if new.features.deformation or (old.triangle_count, old.analytic_count, old.features) != (
        new.triangle_count,
        new.analytic_count,
        new.features,
    ):
        return False
    if any(new.arrays[name].shape != array.shape for name, array in old.arrays.items()):
        return False
    if old.instances.count != new.instances.count or not np.array_equal(old.instances.group_of, new.instances.group_of):
        return False
    pairs = [(old.arrays[name], new.arrays[name]) for name in ("triangles", "primitive_shape", *_SHARED)]
    if not all(a is b or np.array_equal(a, b) for a, b in pairs):
        return False
    masked, now = masked_primitives(old), masked_primitives(new)
    return masked is None or now is None or bool(np.array_equal(masked, now))  # with the same features, both or neither
