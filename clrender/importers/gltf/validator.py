"""Validates a glTF file: each object by itself, and whether references are consistent."""

from __future__ import annotations

import re
from typing import Any, Final

from clrender.importers.gltf.document import Document
from clrender.importers.gltf.extensions import check_declared, check_required
from clrender.importers.gltf.rules import Walk
from clrender.importers.gltf.schema import COMPONENTS, ROOT
from clrender.wording import counted, quoted

__all__ = ["BYTES", "element_bytes", "validate"]

BYTES: Final = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Bytes of a component, by its type."""
_ROUNDED: Final = 1e-4
"""Largest difference of a last row from 0, 0, 0, 1 that is taken for an error of rounding."""
_VERSION: Final = re.compile(r"([0-9]{1,9})\.([0-9]{1,9})\Z")


def validate(document: Document) -> None:
    """Validate everything except the content of buffers and images, and normalise the types of numbers.

    Raises
    ------
    SceneError
        With the JSON pointer of the first fault.
    """
    _check_version(document)
    check_required(document)
    walk = Walk(document)
    ROOT(walk, document.root, "")
    check_declared(walk, document)
    for index, view in enumerate(document.items("bufferViews")):
        if view["byteLength"] == 0:
            document.forgive(f"/bufferViews/{index}/byteLength", "is 0, but must be at least 1; leave the view out")
        _check_view(document, view, f"/bufferViews/{index}")
    for index, accessor in enumerate(document.items("accessors")):
        _check_accessor(document, accessor, f"/accessors/{index}")
    for index, camera in enumerate(document.items("cameras")):
        _check_camera(document, camera, f"/cameras/{index}")
    for index, image in enumerate(document.items("images")):
        if ("uri" in image) == ("bufferView" in image):
            raise document.fault(f"/images/{index}", "must have either `uri` or `bufferView`; keep one of them")
    _check_tree(document)
    for index, node in enumerate(document.items("nodes")):
        _check_node(document, node, f"/nodes/{index}")


def _check_version(document: Document) -> None:
    asset = document.root.get("asset")
    if not isinstance(asset, dict):
        raise document.fault("", "has no `asset` with the version of glTF, which it must have; export it again")
    if "version" not in asset:
        raise document.fault("/asset", "has no `version`, which it must have; export it again")
    found: dict[str, tuple[int, int]] = {}
    for key in ("version", "minVersion"):
        if key in asset:
            if isinstance(asset[key], int | float) and not isinstance(asset[key], bool):
                document.forgive(f"/asset/{key}", 'is a number, but must be a text such as "2.0"; export it again')
                asset[key] = f"{float(asset[key]):.1f}" if abs(asset[key]) < 1e6 else ""
            match = _VERSION.match(asset[key]) if isinstance(asset[key], str) else None
            if match is None:
                raise document.fault(f"/asset/{key}", 'is no version such as "2.0"; export it again')
            found[key] = int(match[1]), int(match[2])
    if found["version"][0] != 2:
        raise document.fault(
            "/asset/version", f"is {quoted(asset['version'])}, but only glTF 2.0 is read; export it so"
        )
    if found.get("minVersion", (0, 0)) > found["version"]:
        document.forgive("/asset/minVersion", "is above its version; export it again")
    if found["version"] > (2, 0):
        document.note(f"/asset/version is {quoted(asset['version'])}; it is read as 2.0")


def _check_view(document: Document, view: dict[str, Any], at: str) -> None:
    room = document.items("buffers")[view["buffer"]]["byteLength"]
    start, size = view.get("byteOffset", 0), view["byteLength"]
    if start + size > room:
        key = "byteOffset" if start >= room else "byteLength"
        raise document.fault(
            f"{at}/{key}", f"takes it to byte {start + size} of a buffer of {counted(room, 'byte')}; export it again"
        )
    stride = view.get("byteStride")
    if stride is None:
        return
    if stride % 4:
        raise document.fault(f"{at}/byteStride", f"is {stride}, but must be a multiple of 4")
    if stride > size:
        raise document.fault(
            f"{at}/byteStride", f"is {stride}, more than the view's {counted(size, 'byte')}; export it again"
        )
    if view.get("target") == 34963:
        document.forgive(f"{at}/byteStride", "is given to a view of indices, which must have none; leave it out")


def element_bytes(accessor: dict[str, Any]) -> tuple[int, int, int]:
    """Bytes of an accessor's element without trailing padding, from one to the next without stride, and of a column.

    Columns of matrices begin at multiples of 4 bytes.
    """
    columns, rows = COMPONENTS[accessor["type"]]
    column = rows * BYTES[accessor["componentType"]]
    padded = -(-column // 4) * 4 if columns > 1 else column
    return padded * (columns - 1) + column, padded * columns, padded


def _check_accessor(document: Document, accessor: dict[str, Any], at: str) -> None:
    kind = accessor["componentType"]
    if accessor.get("normalized") and kind in (5125, 5126):
        raise document.fault(f"{at}/normalized", "is true, but only whole numbers of 8 or 16 bits can be; leave it out")
    if "type" not in accessor:
        return
    columns, rows = COMPONENTS[accessor["type"]]
    for key in ("min", "max"):
        if key in accessor and len(accessor[key]) != columns * rows:
            raise document.fault(
                f"{at}/{key}", f"has {counted(len(accessor[key]), 'number')}, but must have {columns * rows}"
            )
    sparse = accessor.get("sparse")
    if sparse is not None and sparse["count"] > accessor["count"]:
        raise document.fault(
            f"{at}/sparse/count", f"is {sparse['count']}, more than the accessor's {accessor['count']}"
        )
    if "bufferView" not in accessor:
        if "byteOffset" in accessor:
            raise document.fault(f"{at}/byteOffset", "is given without bufferView; leave it out")
    else:
        _check_room(document, accessor, at, columns > 1)
    if sparse is not None:
        tight, step, _ = element_bytes(accessor)
        indices, values = sparse["indices"], sparse["values"]
        _check_part(document, indices, sparse["count"], BYTES[indices["componentType"]], 0, f"{at}/sparse/indices")
        _check_part(document, values, sparse["count"], step, step - tight, f"{at}/sparse/values", BYTES[kind])


def _check_room(document: Document, accessor: dict[str, Any], at: str, matrix: bool) -> None:
    """Check that an accessor lies within its view, with the alignment of its type."""
    view = document.items("bufferViews")[accessor["bufferView"]]
    size, start = BYTES[accessor["componentType"]], accessor.get("byteOffset", 0)
    tight, step, _ = element_bytes(accessor)
    stride = view.get("byteStride", step)
    if start % size:
        text = f"is {start}, but must be a multiple of {size}, as its numbers are; export it again"
        document.forgive(f"{at}/byteOffset", text)
    elif (start + view.get("byteOffset", 0)) % size:
        total = start + view.get("byteOffset", 0)
        document.forgive(
            at, f"begins at byte {total} of its buffer, which must be a multiple of {size}; export it again"
        )
    if matrix and start % 4:
        document.forgive(f"{at}/byteOffset", "puts a matrix where no multiple of 4 bytes is; export it again")
    if stride < tight:
        raise document.fault(
            at, f"has elements of {counted(tight, 'byte')}, but byteStride is {stride}; export it again"
        )
    end = start + stride * (accessor["count"] - 1) + tight
    if end > view["byteLength"]:
        raise document.fault(
            at, f"needs {counted(end, 'byte')}, but its buffer view has {view['byteLength']}; export it again"
        )


def _check_part(
    document: Document, part: dict[str, Any], count: int, step: int, padding: int, at: str, multiple: int | None = None
) -> None:
    """Check that indices or values of a sparse accessor lie within their view."""
    view, start = document.items("bufferViews")[part["bufferView"]], part.get("byteOffset", 0)
    if "byteStride" in view or "target" in view:
        raise document.fault(f"{at}/bufferView", "names a view with byteStride or target, which must have none")
    if (start + view.get("byteOffset", 0)) % (multiple or step):
        raise document.fault(f"{at}/byteOffset", f"begins where no multiple of {counted(multiple or step, 'byte')} is")
    end = start + step * count - padding
    if end > view["byteLength"]:
        raise document.fault(
            at, f"needs {counted(end, 'byte')}, but its buffer view has {view['byteLength']}; export it again"
        )


def _check_camera(document: Document, camera: dict[str, Any], at: str) -> None:
    kind = camera.get("type")
    if kind is None:
        return
    if kind not in camera:
        raise document.fault(at, f"has no `{kind}`, which a camera of that type must have; add it")
    if "perspective" in camera and "orthographic" in camera:
        raise document.fault(at, "has both `perspective` and `orthographic`; keep the one of its type")
    lens = camera[kind]
    for key in ("ymag", "xmag"):
        if lens.get(key) == 0.0:
            raise document.fault(f"{at}/{kind}/{key}", "is 0; it must be above 0 or below")
    if "zfar" in lens and lens["zfar"] <= lens["znear"]:
        raise document.fault(f"{at}/{kind}", "has a zfar that is not beyond its znear; export it again")


def _check_tree(document: Document) -> None:
    """Check that no node has two parents or is its own ancestor, and that scenes refer to root nodes.

    A node stays with the first of its parents, and what a scene names beside its parent is drawn with the parent.
    """
    nodes = document.items("nodes")
    parents: dict[int, int] = {}
    for index, node in enumerate(nodes):
        kept: list[int] = []
        for number, child in enumerate(node.get("children", [])):
            at = f"/nodes/{index}/children/{number}"
            if child == index:
                raise document.fault(at, f"names node {child}, which is itself")
            if child in parents:
                document.forgive(
                    at, f"names node {child}, which is a child of node {parents[child]} already; leave it out"
                )
                continue
            parents[child] = index
            kept.append(child)
        if "children" in node:
            node["children"] = kept
    sound = {index for index in range(len(nodes)) if index not in parents}
    for index in range(len(nodes)):
        way: list[int] = []
        while index not in sound and len(way) <= len(nodes):
            way.append(index)
            index = parents[index]
        if len(way) > len(nodes):
            raise document.fault(f"/nodes/{index}/children", "lead back to the node itself; export it again")
        sound.update(way)
    for index, scene in enumerate(document.items("scenes")):
        roots = scene.get("nodes", [])
        below = _below(nodes, roots)
        for number, root in enumerate(roots):
            if root in parents:
                text = f"names node {root}, which is a child of node {parents[root]}; name only roots"
                document.forgive(f"/scenes/{index}/nodes/{number}", text)
        if "nodes" in scene:
            scene["nodes"] = [root for root in roots if root not in below]


def _below(nodes: list[dict[str, Any]], tops: list[int]) -> set[int]:
    """Nodes that are below one of these, each visited once."""
    found: set[int] = set()
    ahead = list(tops)
    while ahead:
        children = [child for child in nodes[ahead.pop()].get("children", []) if child not in found]
        found.update(children)
        ahead += children
    return found


def _check_node(document: Document, node: dict[str, Any], at: str) -> None:
    others = [key for key in ("translation", "rotation", "scale") if key in node]
    if "matrix" in node and others:
        document.forgive(
            f"{at}/matrix", "is given beside translation, rotation or scale, and counts; keep one or the other"
        )
        for key in others:
            del node[key]
    matrix = node.get("matrix")
    if matrix is not None and matrix[3::4] != [0.0, 0.0, 0.0, 1.0]:
        text = "has a last row that is not 0, 0, 0, 1: only affine transforms are known"
        if max(abs(x - y) for x, y in zip(matrix[3::4], (0.0, 0.0, 0.0, 1.0), strict=True)) > _ROUNDED:
            raise document.fault(f"{at}/matrix", text)
        document.forgive(f"{at}/matrix", f"{text}; export it again")
    if "rotation" in node and (
        max(abs(x) for x in node["rotation"]) > 1.0 or sum(x * x for x in node["rotation"]) < 1e-6
    ):
        document.forgive(f"{at}/rotation", "is no rotation: its quaternion must have length 1; export it again")
        if sum(x * x for x in node["rotation"]) < 1e-6:
            del node["rotation"]
    if "skin" in node and "mesh" not in node:
        document.forgive(f"{at}/skin", "is given without a mesh; leave it out")
        del node["skin"]
    if "weights" in node:
        meshes = document.items("meshes")
        targets = _targets(meshes[node["mesh"]]) if "mesh" in node else 0
        if len(node["weights"]) != targets:
            text = f"has {counted(len(node['weights']), 'number')}, but the mesh has {targets} targets; export it again"
            document.forgive(f"{at}/weights", text)


def _targets(mesh: dict[str, Any]) -> int:
    return len(mesh["primitives"][0].get("targets", []))
