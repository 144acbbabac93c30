"""
Robots of URDF files: a tree of links, what is seen of them, and the joints that move them.

yourdfpy reads the file, and `RobotRecord` is what is used of it; the meshes that it names are read
as any other mesh file is.

References
----------
.. [1] ROS, "URDF XML specifications", https://wiki.ros.org/urdf/XML.
.. [2] ROS, RViz: a mesh keeps its own materials, COLLADA files their unit but not their up axis.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import (
    MAX_LISTED_KINDS,
    LeftOut,
    MeshFileError,
    make_missing_package_error,
    reason_of,
)
from rasterjit.io.primitives import Context
from rasterjit.io.resources import Resources, RobotResources, extension_of, quote_name
from rasterjit.io.text.mesh_builder import drop_textures, srgb_to_rgba
from rasterjit.io.threemf.package import MEMORY_PER_XML_BYTE
from rasterjit.scene.joints import JOINT_KINDS, Follows, Joint
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import Texture
from rasterjit.scene.transforms import compose

FIXED_KINDS = ("fixed", "planar", "floating")
"""Kinds of joints that no single number moves."""

_UNSEEN = ("collision", "inertial", "transmission", "gazebo", "sensor")
"""Elements that are passed over: nothing of them is drawn."""

_KNOWN = {
    "robot": ("link", "joint", "material"),
    "link": ("visual",),
    "visual": ("origin", "geometry", "material"),
    "joint": (
        "origin", "parent", "child", "axis", "calibration", "dynamics", "limit", "mimic",
        "safety_controller",
    ),
}  # fmt: skip
"""Elements that are read, or say how a joint is driven, by what they are in."""

_MESH_UNIT = re.compile(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)")
"""The unit in the header of a COLLADA file, metres."""

_MESH_HEADER_BYTES = 1 << 16
"""Bytes of a COLLADA file that are searched for the unit."""

_SECTIONS, _SUBDIVISIONS = 64, 3
"""Sides of a cylinder, and how often the faces of a ball's icosahedron are cut in four."""

_NODE_MEMORY = 16_384
"""Memory of a node: itself, and its row in each frame."""


@dataclass(frozen=True)
class VisualRecord:
    """
    A shape of a link.

    Parameters
    ----------
    link : str
    shape : {"box", "cylinder", "sphere", "mesh"}
    size : tuple of float
        Three sides; radius and length; radius; factors along three axes.
    origin : (4, 4) float64
        ``link_from_shape``.
    file : str, optional
        Of a mesh.
    rgba : tuple of float, optional
        sRGB and alpha, 0 to 1.
    texture : str, optional
        The file of a picture.
    """

    link: str
    shape: str
    size: tuple[float, ...]
    origin: NDArray[np.float64]
    file: str | None = None
    rgba: tuple[float, ...] | None = None
    texture: str | None = None


@dataclass(frozen=True)
class JointRecord:
    """
    A joint as the file has it: radians or metres.

    Parameters
    ----------
    name, kind, parent, child : str
    origin : (4, 4) float64
        ``parent_from_child`` at value 0.
    axis : tuple of float
    limits : (float, float), optional
    mimic : (str, float, float), optional
        Name of another joint, factor and offset.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: NDArray[np.float64]
    axis: tuple[float, ...]
    limits: tuple[float, float] | None = None
    mimic: tuple[str, float, float] | None = None


@dataclass(frozen=True)
class RobotRecord:
    """
    A robot as plain data, a sound tree.

    Parameters
    ----------
    links : list of str
    visuals : list of VisualRecord
    joints : list of JointRecord
    """

    links: list[str]
    visuals: list[VisualRecord]
    joints: list[JointRecord]


def read_urdf(path: Path, resources: Resources, left_out: LeftOut) -> RobotRecord:
    """
    Read a URDF file by yourdfpy, without the files that it names.

    Raises
    ------
    MeshFileError
        If yourdfpy is not installed, the file is no XML of a robot, or links and joints make no
        tree.
    """
    resources.budget.take("the file", path.stat().st_size * MEMORY_PER_XML_BYTE)
    try:
        import yourdfpy
        from lxml import etree
    except ImportError as error:
        raise make_missing_package_error(path, "urdf", error, "'rasterjit[robots]'") from error
    try:
        root = _parse_xml(path)
        _strip_unseen(root, left_out)
        source = BytesIO(etree.tostring(root))
        robot = yourdfpy.URDF.load(source, build_scene_graph=False, load_meshes=False).robot
        record = _convert_robot(robot, left_out)
        _check_tree(record)
    except Exception as error:
        # yourdfpy raises what it likes about elements that lack something.
        raise MeshFileError(f"{path} could not be read as .urdf: {reason_of(error)}") from error
    return record


def _parse_xml(path: Path) -> Any:
    """Return the root of an XML file; prefixes that stand for no name space are let pass."""
    from lxml import etree

    content, options = path.read_bytes(), {"resolve_entities": False, "no_network": True}
    parser = etree.XMLParser(**options)
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError:
        if any(one.domain_name != "NAMESPACE" for one in parser.error_log):
            raise
        root = etree.fromstring(content, etree.XMLParser(**options, recover=True))
    if etree.QName(root).localname != "robot":
        raise ValueError(f"it must be XML with a robot element, got {str(root.tag)[:80]!r}")
    return root


def _strip_unseen(root: Any, left_out: LeftOut) -> None:
    """Remove what yourdfpy need not understand; note what is removed and might be seen."""
    from lxml import etree

    etree.strip_elements(root, *_UNSEEN, with_tail=False)
    root.set("name", root.get("name", ""))
    for owner in [root, *root.iter("link", "visual", "joint")]:
        known = _KNOWN[etree.QName(owner).localname]
        for element in list(owner):
            if not isinstance(element.tag, str) or ":" in element.tag or "{" in element.tag:
                owner.remove(element)
            elif element.tag not in known:
                left_out.note(f"{element.tag} of a {owner.tag}")
                owner.remove(element)
    for visual in list(root.iter("visual")):
        geometry = visual.find("geometry")
        shapes = [] if geometry is None else geometry.findall("*")
        if not shapes:
            left_out.note("visual without a shape")
            visual.getparent().remove(visual)
        elif len(shapes) > 1:
            left_out.note("further shape of a visual", len(shapes) - 1)


def _convert_robot(robot: Any, left_out: LeftOut) -> RobotRecord:
    """Return what is used of a robot of yourdfpy's."""
    materials = [one.material for link in robot.links for one in link.visuals if one.material]
    # A material may be described anywhere, and named anywhere else.
    by_name = {one.name: one for one in (*materials, *robot.materials) if one.color or one.texture}
    visuals = []
    for link in robot.links:
        for visual in link.visuals:
            material = visual.material
            if material is not None and not (material.color or material.texture):
                material = by_name.get(material.name)
                if material is None:
                    left_out.note(f"material {visual.material.name!r} that is described nowhere")
            visuals.append(_convert_visual(link.name, visual, material))
    moving = {one.name for one in robot.joints if one.type in JOINT_KINDS}
    for joint in robot.joints:
        if joint.mimic is not None and joint.mimic.joint not in moving:
            left_out.note(f"mimic of {joint.mimic.joint!r}, which is no joint that moves")
            joint.mimic = None
    return RobotRecord(
        [link.name for link in robot.links], visuals,
        [_convert_joint(one, left_out) for one in robot.joints],
    )  # fmt: skip


def _convert_visual(link: str, visual: Any, material: Any) -> VisualRecord:
    """Return a shape of a link with its material, or raise ``ValueError``."""
    geometry, file = visual.geometry, None
    if geometry.box is not None:
        shape, size = "box", geometry.box.size
    elif geometry.cylinder is not None:
        shape, size = "cylinder", (geometry.cylinder.radius, geometry.cylinder.length)
    elif geometry.sphere is not None:
        shape, size = "sphere", (geometry.sphere.radius,)
    else:
        shape, file = "mesh", geometry.mesh.filename
        if not file:
            raise ValueError(f"a mesh of link {link!r} must have a filename")
        scale = geometry.mesh.scale
        size = np.broadcast_to(1.0 if scale is None else scale, 3)
    numbers = tuple(map(float, size))
    expected = {"box": 3, "cylinder": 2, "sphere": 1, "mesh": 3}[shape]
    is_valid = len(numbers) == expected and bool(np.isfinite(numbers).all())
    # Boxes and cylinders may be flat.
    is_valid = is_valid and (shape == "mesh" or min(numbers) >= 0.0)
    if not is_valid or (shape in ("cylinder", "sphere") and not numbers[0]):
        kind = "factors" if shape == "mesh" else "sizes, none below 0 and no radius of 0"
        raise ValueError(f"a {shape} of link {link!r} must have {expected} {kind}, got {numbers}")
    color = None if material is None else material.color
    rgba = None if color is None else tuple(map(float, color.rgba))
    if rgba is not None and (len(rgba) != 4 or not np.isfinite(rgba).all()):
        raise ValueError(f"a colour of link {link!r} must be 4 numbers, got {rgba}")
    texture = None if material is None or material.texture is None else material.texture.filename
    origin = _check_origin(visual.origin, f"a visual of link {link!r}")
    return VisualRecord(link, shape, numbers, origin, file, rgba, texture)


def _convert_joint(joint: Any, left_out: LeftOut) -> JointRecord:
    """Return a joint, or raise ``ValueError``."""
    kinds = (*JOINT_KINDS, *FIXED_KINDS)
    if joint.type not in kinds:
        raise ValueError(
            f"joint {joint.name!r}: type must be one of {', '.join(kinds)}, got {joint.type!r}"
        )
    axis = tuple(map(float, joint.axis))
    if joint.type in JOINT_KINDS and (
        len(axis) != 3 or not any(axis) or not np.isfinite(axis).all()
    ):
        raise ValueError(f"joint {joint.name!r}: axis must be 3 numbers, not all 0, got {axis}")
    if joint.type in ("planar", "floating"):
        left_out.note(f"motion of the {joint.type} joint {joint.name!r}")
    limit, limits = joint.limit, None
    if joint.type in ("revolute", "prismatic") and limit is not None:
        # Where one is missing it is 0; who gives neither means none.
        if limit.lower is not None or limit.upper is not None:
            limits = float(limit.lower or 0.0), float(limit.upper or 0.0)
        low, high = (0.0, 0.0) if limits is None else limits
        if not low <= high or math.inf in (math.degrees(low), -math.degrees(high)):
            left_out.note(f"limits {low:g}..{high:g} of the joint {joint.name!r}")
            limits = None
    mimic = joint.mimic
    follows = None if mimic is None else (mimic.joint, mimic.multiplier, mimic.offset)
    if follows is not None and not np.isfinite(follows[1:]).all():
        raise ValueError(f"joint {joint.name!r}: its mimic must have finite numbers, got {follows}")
    origin = _check_origin(joint.origin, f"joint {joint.name!r}")
    return JointRecord(
        joint.name, joint.type, joint.parent, joint.child, origin, axis, limits, follows
    )


def _check_origin(origin: Any, label: str) -> NDArray[np.float64]:
    """Return an origin, (4, 4) float64, or raise ``ValueError``."""
    matrix = np.eye(4) if origin is None else np.asarray(origin, np.float64)
    if not np.isfinite(matrix).all():
        raise ValueError(f"{label}: origin must be finite numbers, got {matrix.tolist()}")
    return matrix


def _check_tree(record: RobotRecord) -> None:
    """Raise ``ValueError`` unless links and joints make a tree, and so do joints that follow."""
    for what, names in (("links", record.links), ("joints", [one.name for one in record.joints])):
        twice = _find_repeated(names)
        if twice is not None:
            raise ValueError(f"it has two {what} {twice!r}")
    if not record.links:
        raise ValueError("it must have a link, got none")
    links, above = set(record.links), dict[str, JointRecord]()
    for joint in record.joints:
        for end, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links:
                raise ValueError(f"joint {joint.name!r}: its {end} must be a link, got {name!r}")
        if joint.child in above:
            raise ValueError(
                f"link {joint.child!r} must hang on one joint, got {above[joint.child].name!r} and "
                f"{joint.name!r}"
            )
        above[joint.child] = joint
    _check_no_circle({child: joint.parent for child, joint in above.items()}, "links", "hang")
    leaders = {one.name: one.mimic[0] for one in record.joints if one.mimic is not None}
    _check_no_circle(leaders, "joints", "mimic each other")


def _find_repeated(names: Iterable[str]) -> str | None:
    """Return a name that stands twice, or None."""
    known: set[str] = set()
    for name in names:
        if name in known:
            return name
        known.add(name)
    return None


def _check_no_circle(above: dict[str, str], what: str, act: str) -> None:
    """Raise ``ValueError`` if the way from a name to what is above it leads in a circle."""
    sound: set[str] = set()
    for start in above:
        path, name = dict[str, None](), start
        while name in above and name not in sound:
            if name in path:
                names = list(path)
                circle = ", ".join(names[names.index(name) :][:MAX_LISTED_KINDS])
                raise ValueError(f"{what} {act} in a circle: {circle}")
            path[name] = None
            name = above[name]
        sound.update(path)


LoadPart = Callable[[Path, Path], Scene]
"""Loads a mesh file, given the folder that all that it names must lie in."""


def build_robot(
    record: RobotRecord, context: Context, resources: RobotResources, on_damage: str,
    load_part: LoadPart,
) -> Scene:  # fmt: skip
    """
    Return the scene of a robot: a node for each link, below it a node for each of its meshes.

    Raises
    ------
    MeshFileError
        If mesh files cannot be found or read and ``on_damage`` is ``"error"``, or nothing is left.
    """
    context.take("its links", _NODE_MEMORY * len(record.links))
    scene, nodes = Scene(), {name: Node(name=name) for name in record.links}
    with _naming(context.source, "its links"):
        _hang_links(record, nodes, scene, context.source)
    _VisualsBuilder(context, resources, load_part).add(record.visuals, nodes, scene, on_damage)
    return scene


@contextmanager
def _naming(source: str, label: str) -> Iterator[None]:
    """Name the file and a part of the robot in errors about what the part is made of."""
    try:
        yield
    except MeshFileError:
        raise
    except ValueError as error:
        raise MeshFileError(
            f"{source} could not be read as .urdf: {label}: {reason_of(error)}"
        ) from error


def _hang_links(record: RobotRecord, nodes: dict[str, Node], scene: Scene, source: str) -> None:
    """Add nodes of links to a scene, below one another, and its joints."""
    for one in record.joints:
        nodes[one.child].transform = one.origin
    # Nodes that carry nothing yet move at once; those above come first.
    joints = _make_joints(record, nodes, source)
    below: dict[str, list[str]] = {name: [] for name in record.links}
    for one in record.joints:
        below[one.parent].append(one.child)
    children = {one.child for one in record.joints}
    pending = [name for name in record.links if name not in children]
    for name in pending:
        if name not in children:
            scene.add(nodes[name])
        for child in below[name]:
            nodes[child].parent = nodes[name]
        pending += below[name]
    for name, joint in joints.items():
        scene.joints.add(name, joint)


def _make_joints(record: RobotRecord, nodes: dict[str, Node], source: str) -> dict[str, Joint]:
    """Return the joints that one number moves."""
    records = {one.name: one for one in record.joints if one.kind in JOINT_KINDS}
    joints: dict[str, Joint] = {}

    def make(one: JointRecord) -> Joint:
        """Return a joint; the one that it follows is there."""
        unit = _unit_of(one)
        limits = None if one.limits is None else (unit * one.limits[0], unit * one.limits[1])
        kind: Any = one.kind
        follows = None
        if one.mimic is not None:
            leader, factor, offset = one.mimic
            ratio = unit / _unit_of(records[leader])
            follows = Follows(joints[leader], ratio * factor, unit * offset)
        return Joint(nodes[one.child], kind, one.axis, limits, follows)

    for name in records:
        chain = [] if name in joints else [name]
        while chain and (mimic := records[chain[-1]].mimic) and mimic[0] not in joints:
            chain.append(mimic[0])
        for link in reversed(chain):
            with _naming(source, f"joint {link!r}"):
                joints[link] = make(records[link])
    return {name: joints[name] for name in records}


def _unit_of(joint: JointRecord) -> float:
    """Return how many degrees, or scene units, are one of the file's unit of a joint."""
    return 1.0 if joint.kind == "prismatic" else math.degrees(1.0)


class _VisualsBuilder:
    """Makes the meshes of visuals, each file and each shape once."""

    def __init__(self, context: Context, resources: RobotResources, load_part: LoadPart) -> None:
        self._context, self._resources, self._load_part = context, resources, load_part
        self._files: dict[str, list[tuple[Mesh, NDArray[np.float64]]]] = {}
        self._shapes: dict[tuple[Any, ...], Mesh] = {}
        self._painted: dict[tuple[int, int], Mesh] = {}
        self._materials: dict[tuple[Any, ...], Material] = {}
        self._counts: dict[str, int] = {}
        self._unread: dict[str, str] = {}

    def add(
        self, visuals: list[VisualRecord], nodes: dict[str, Node], scene: Scene, on_damage: str
    ) -> None:
        """Add the meshes of all visuals to a scene, below the nodes of their links."""
        source, left_out = self._context.source, self._context.left_out
        for visual in visuals:
            with _naming(source, f"a {visual.shape} of link {visual.link!r}"):
                self._add_visual(visual, nodes[visual.link], scene)
        if self._unread and on_damage == "error":
            names = list(self._unread)
            listed = "; ".join(f"{name}: {self._unread[name]}" for name in names[:MAX_LISTED_KINDS])
            more = f"; and {len(names) - MAX_LISTED_KINDS} more" * (len(names) > MAX_LISTED_KINDS)
            raise MeshFileError(
                f"{source} names meshes that cannot be read: {listed}{more}; resource_root or "
                "ROS_PACKAGE_PATH names the folder of packages, on_damage='warn' loads the rest"
            )
        for name, reason in self._unread.items():
            left_out.note(f"mesh {name}", reason=f": {reason}")
        for name in self._resources.renamed:
            left_out.note(f"package {name}", reason=", in whose place the file's folder is taken")
        if not scene.nodes:
            notes = f" ({left_out})" if str(left_out) else ""
            raise MeshFileError(f"{source} holds no visual to draw{notes}")

    def _add_visual(self, visual: VisualRecord, node: Node, scene: Scene) -> None:
        """Add the meshes of a visual to a scene, below the node of its link."""
        material = self._get_material(visual)
        for mesh, shape_from_mesh in self._make_parts(visual):
            self._context.take(f"a place of link {visual.link[:80]!r}", _NODE_MEMORY)
            count = self._counts[visual.link] = self._counts.get(visual.link, 0) + 1
            place = compose(visual.origin, shape_from_mesh)
            scene.add(self._paint(mesh, material), place, f"{visual.link}/{count}", parent=node)

    def _make_parts(self, visual: VisualRecord) -> list[tuple[Mesh, NDArray[np.float64]]]:
        """Return the meshes of a visual, and where each stands in it."""
        if visual.file is None:
            key = visual.shape, visual.size
            if key not in self._shapes:
                self._shapes[key] = _make_shape(visual.shape, visual.size)
            return [(self._shapes[key], np.eye(4))]
        if visual.file not in self._files:
            self._files[visual.file] = self._load_file(visual.file)
        scale = np.diag([*visual.size, 1.0])
        return [(mesh, compose(scale, place)) for mesh, place in self._files[visual.file]]

    def _load_file(self, name: str) -> list[tuple[Mesh, NDArray[np.float64]]]:
        """Return the meshes of a file, and where each stands in it; none, with a reason."""
        left_out = self._context.left_out
        try:
            path, root = self._resources.find(name)
            if extension_of(path) == "urdf":
                raise ValueError("a robot is no mesh")
            part = self._load_part(path, root).posed()
            unit = np.diag([*[_read_unit(path)] * 3, 1.0])
        except ValueError as error:
            if self._context.budget is not None:
                self._context.budget.check()
            self._unread[quote_name(name)] = " ".join(str(error).split())
            return []
        for light in part.lights:
            left_out.note(f"{type(light).__name__} of a mesh file")
        if part.camera is not None:
            left_out.note("camera of a mesh file")
        return [(node.mesh, compose(unit, node.world_matrix)) for node in part.nodes]

    def _get_material(self, visual: VisualRecord) -> Material | None:
        """Return the material that a visual names, or None."""
        if visual.rgba is None and visual.texture is None:
            return None
        key = visual.rgba, visual.texture
        if key not in self._materials:
            rgba = (1.0, 1.0, 1.0, 1.0) if visual.rgba is None else visual.rgba
            linear = srgb_to_rgba(np.array([rgba]))[0].tolist()
            self._materials[key] = Material(
                base_color=linear, alpha_mode="blend" if linear[3] < 1.0 else "opaque",
                base_color_texture=self._read_texture(visual.texture),
            )  # fmt: skip
        return self._materials[key]

    def _read_texture(self, name: str | None) -> Texture | None:
        """Return a picture as a texture; None, with a note, if it cannot be read."""
        if name is None:
            return None
        label = f"picture {quote_name(name)}"
        try:
            content = self._resources.read(name)
            return Texture(self._resources.decoder.decode("picture", content, label, ()))
        except Exception as error:
            # Pillow raises any error about a damaged picture.
            self._context.left_out.note(f"{label} that cannot be read: {reason_of(error)}")
            return None

    def _paint(self, mesh: Mesh, material: Material | None) -> Mesh:
        """Return a mesh with a material, unless it has one, or colours, of its own."""
        own = mesh.material
        is_bare = own.base_color is None and own.base_color_texture is None
        is_bare = is_bare and mesh.vertex_colors is None and mesh.face_colors is None
        if material is None or not is_bare:
            return mesh
        key = id(mesh), id(material)
        if key not in self._painted:
            if mesh.uv is None:
                material = drop_textures(self._context.source, material, self._context.left_out)
            self._painted[key] = mesh._with(_material=material)
        return self._painted[key]


def _make_shape(shape: str, size: tuple[float, ...]) -> Mesh:
    """Return a box, a cylinder along z or a ball, about the origin."""
    from trimesh import creation

    with np.errstate(all="ignore"):
        if shape == "box":
            made = creation.box(size)
        elif shape == "cylinder":
            radius, height = size
            made = creation.cylinder(radius, height, sections=_SECTIONS)
        else:
            made = creation.icosphere(_SUBDIVISIONS, size[0])
        return Mesh(made.vertices, made.faces).split_creases()


def _read_unit(path: Path) -> float:
    """Return how many metres a unit of a mesh file is: COLLADA says it, other formats do not."""
    if extension_of(path) != "dae":
        return 1.0
    with path.open("rb") as opened:
        match = _MESH_UNIT.search(opened.read(_MESH_HEADER_BYTES))
    unit = float(match[1]) if match else 1.0
    if not 0.0 < unit < math.inf:
        raise ValueError(f"its unit must be above 0, got {unit:g}")
    return unit
