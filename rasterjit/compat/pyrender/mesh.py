"""Meshes: lists of primitives, each of one material."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.compat.pyrender.constants import GLTF
from rasterjit.compat.pyrender.material import MetallicRoughnessMaterial, as_shown
from rasterjit.io.trimesh.materials import is_placeholder
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh as SceneMesh
from rasterjit.scene.validation import finite_array, in_short

if TYPE_CHECKING:
    import trimesh
    from trimesh.parent import Geometry

_GREY = (0.3, 0.3, 0.3, 1.0)
"""The colour of meshes without a material."""
_MODES = GLTF.POINTS, GLTF.LINES, GLTF.LINE_LOOP, GLTF.LINE_STRIP, GLTF.TRIANGLES
"""What primitives may be."""
_METALLIC, _ROUGHNESS = 0.2, 0.8
"""Of meshes without a material, or with colours alone."""


class Primitive:
    """
    Triangles or points of one material.

    Parameters
    ----------
    positions : (V, 3) array_like
    normals : (V, 3) array_like, optional
        Default: those of the surface.
    texcoord_0 : (V, 2) array_like, optional
        Texture coordinates.
    color_0 : (V, 3) or (V, 4) array_like, optional
        Floats in 0..1 or bytes; they multiply what the material shows.
    indices : (F, 3) array_like of int, optional
        Vertices of each triangle; default: each three.
    material : MetallicRoughnessMaterial, optional
    mode : int
        ``GLTF.TRIANGLES`` or ``GLTF.POINTS``.
    poses : (N, 4, 4) array_like, optional
        Where instances of it stand, relative to the node.
    tangents, texcoord_1, joints_0, weights_0, targets
        Taken and without effect.

    Raises
    ------
    ValueError
        If an array is no such thing, or the mode is another.
    """

    def __init__(
        self,
        positions: ArrayLike,
        normals: ArrayLike | None = None,
        tangents: ArrayLike | None = None,
        texcoord_0: ArrayLike | None = None,
        texcoord_1: ArrayLike | None = None,
        color_0: ArrayLike | None = None,
        joints_0: ArrayLike | None = None,
        weights_0: ArrayLike | None = None,
        indices: ArrayLike | None = None,
        material: MetallicRoughnessMaterial | None = None,
        mode: int | None = None,
        targets: Any = None,
        poses: ArrayLike | None = None,
    ) -> None:
        self.positions = finite_array("positions", positions, (None, 3))
        self.mode = GLTF.TRIANGLES if mode is None else mode
        if self.mode not in _MODES:
            raise ValueError(f"mode must be TRIANGLES, POINTS or one of lines, got {mode!r}")
        count = len(self.positions)
        self.normals = None if normals is None else finite_array("normals", normals, (count, 3))
        self.texcoord_0 = None
        if texcoord_0 is not None:
            coordinates = np.asarray(texcoord_0)
            self.texcoord_0 = finite_array("texcoord_0", coordinates[:, :2], (count, 2))
        self.color_0 = None if color_0 is None else _colors(color_0, count)
        self.indices = None if indices is None else np.asarray(indices)
        self.material = MetallicRoughnessMaterial() if material is None else material
        if not isinstance(self.material, MetallicRoughnessMaterial):
            raise ValueError(
                f"material must be a MetallicRoughnessMaterial, got {in_short(material)}"
            )
        self.poses = None
        if poses is not None:
            self.poses = finite_array("poses", np.asarray(poses).reshape(-1, 4, 4), (None, 4, 4))
        self._drawn: dict[Any, Any] = {}
        # What was made of it, by what it was made for.

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64: least and largest coordinates, instances included."""
        corners = self.positions
        if self.poses is not None:
            turned = [corners[:, None] * pose[:3, :3] for pose in self.poses]
            moved = [
                (one[..., 0] + one[..., 1]) + one[..., 2] + pose[:3, 3]
                for one, pose in zip(turned, self.poses, strict=True)
            ]
            corners = np.concatenate(moved)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    @property
    def least_alpha(self) -> float:
        """The least alpha of any vertex."""
        return 1.0 if self.color_0 is None else float(self.color_0[:, 3].min())

    def triangles(self) -> NDArray[np.int64]:
        """Return the vertices of each triangle, (F, 3)."""
        if self.indices is not None:
            return self.indices.reshape(-1, 3).astype(np.int64)
        count = len(self.positions)
        if count % 3:
            raise ValueError(f"positions must be three a triangle, got {count}")
        return np.arange(count).reshape(-1, 3)

    def drawn(self, is_lit: bool, look: Material, is_turned: bool = False) -> SceneMesh:
        """
        Return its triangles as RasterJIT has them; the same as long as the look is the same.

        Parameters
        ----------
        is_lit : bool
            Whether colours are lit, else they are codes.
        look : Material
        is_turned : bool
            Whether faces go the other way round.
        """
        key = is_lit, is_turned, look.shading
        if key not in self._drawn:
            indices = self.triangles()
            self._drawn[key] = made = SceneMesh(
                self.positions, indices[:, ::-1] if is_turned else indices, normals=self.normals,
                uv=self.texcoord_0, colors=self.colors(is_lit), material=look,
            )  # fmt: skip
            if is_lit:
                # Copies have them, too.
                made.vertex_normals()
        if self._drawn[key].material != look:
            # What was drawn before keeps its own.
            self._drawn[key] = copy.copy(self._drawn[key])
            self._drawn[key].material = look
        return self._drawn[key]

    def colors(self, is_lit: bool) -> NDArray[np.float64] | None:
        """Return its colours, (V, 4) float64, as linear light; without lights they are codes."""
        if self.color_0 is None or is_lit:
            return self.color_0
        return as_shown(self.color_0)


class Mesh:
    """
    Primitives that stand together.

    Parameters
    ----------
    primitives : list of Primitive
    name : str, optional
    weights : optional
        Taken and without effect.
    is_visible : bool
        Whether it is drawn.

    Raises
    ------
    ValueError
        If ``primitives`` are none.
    """

    def __init__(
        self,
        primitives: Iterable[Primitive],
        name: str | None = None,
        weights: Any = None,
        is_visible: bool = True,
    ) -> None:
        self.primitives = list(primitives)
        if not all(isinstance(one, Primitive) for one in self.primitives) or not self.primitives:
            raise ValueError(f"primitives must be Primitives, got {in_short(primitives)}")
        self.name = name
        self.is_visible = is_visible

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64: least and largest coordinates."""
        all_bounds = np.stack([one.bounds for one in self.primitives])
        return np.stack([all_bounds[:, 0].min(axis=0), all_bounds[:, 1].max(axis=0)])

    @property
    def centroid(self) -> NDArray[np.float64]:
        """(3,) float64: the middle of its bounds."""
        low, high = self.bounds
        return (low + high) / 2.0

    @property
    def extents(self) -> NDArray[np.float64]:
        """(3,) float64: the sides of its bounds."""
        low, high = self.bounds
        return high - low

    @property
    def is_transparent(self) -> bool:
        """Whether any material asks for blending."""
        return any(one.material.alphaMode == "BLEND" for one in self.primitives)

    @staticmethod
    def from_points(
        points: ArrayLike,
        colors: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        is_visible: bool = True,
        poses: ArrayLike | None = None,
    ) -> Mesh:
        """
        Return a mesh of points, squares of the renderer's ``point_size``.

        Parameters
        ----------
        points : (N, 3) array_like
        colors : (N, 3) or (N, 4) array_like, optional
            Floats in 0..1 or bytes.
        normals : (N, 3) array_like, optional
            Default: towards the camera.
        is_visible : bool
        poses : (M, 4, 4) array_like, optional
            Where instances of it stand.

        Raises
        ------
        ValueError
            If an array is no such thing.
        """
        primitive = Primitive(
            points, normals=normals, color_0=colors, mode=GLTF.POINTS, poses=poses
        )
        return Mesh([primitive], is_visible=is_visible)

    @staticmethod
    def from_trimesh(
        mesh: Geometry | list[trimesh.Trimesh],
        material: MetallicRoughnessMaterial | None = None,
        is_visible: bool = True,
        poses: ArrayLike | None = None,
        wireframe: bool = False,
        smooth: bool = True,
    ) -> Mesh:
        """
        Return a mesh of trimesh's.

        Parameters
        ----------
        mesh : trimesh.Trimesh or list of them
            Its colours or its material and textures are used.
        material : MetallicRoughnessMaterial, optional
            In place of the mesh's.
        is_visible : bool
        poses : (N, 4, 4) array_like, optional
            Where instances of it stand.
        wireframe : bool
            Whether its edges are drawn in place of its faces.
        smooth : bool
            Whether normals are interpolated, or each face is flat; face colours need the latter.

        Raises
        ------
        TypeError
            If it is no ``trimesh.Trimesh``.
        ValueError
            If it has face colours and is smooth.
        """
        import trimesh

        given = list(mesh) if isinstance(mesh, (list, tuple, set, np.ndarray)) else [mesh]
        primitives = []
        for one in given:
            if not isinstance(one, trimesh.Trimesh):
                raise TypeError(f"mesh must be a trimesh.Trimesh or a list, got {in_short(one)}")
            primitives.append(_primitive(one, material, poses, wireframe, smooth))
        return Mesh(primitives, is_visible=is_visible)


def _primitive(
    mesh: trimesh.Trimesh,
    material: MetallicRoughnessMaterial | None,
    poses: ArrayLike | None,
    wireframe: bool,
    smooth: bool,
) -> Primitive:
    """Return one mesh of trimesh's as a primitive."""
    faces = np.asarray(mesh.faces)
    colors, uv, own = _looks(mesh, smooth, has_material=material is not None)
    # Each has its own, which may be changed.
    look = own if material is None else copy.copy(material)
    look.wireframe = wireframe
    if smooth:
        positions, normals, indices = mesh.vertices, mesh.vertex_normals, faces
    else:
        positions = mesh.vertices[faces].reshape(-1, 3)
        normals, indices = np.repeat(mesh.face_normals, 3, axis=0), None
        uv = None if uv is None else uv[faces].reshape(-1, 2)
    return Primitive(
        np.array(positions), normals=np.array(normals), texcoord_0=uv, color_0=colors,
        indices=indices, material=look, poses=poses,
    )  # fmt: skip


def _looks(mesh: trimesh.Trimesh, smooth: bool, has_material: bool) -> tuple[Any, Any, Any]:
    """Return vertex colours, texture coordinates of vertices, and material."""
    visual = mesh.visual
    if visual.kind == "texture":
        uv = None if visual.uv is None else np.asarray(visual.uv)[:, :2]
        return None, uv, None if has_material else _textured(visual.material)
    if has_material or not visual.defined:
        return None, None, None if has_material else _plain(_GREY)
    if visual.kind == "vertex":
        colors = np.asarray(visual.vertex_colors)
        return colors if smooth else colors[mesh.faces].reshape(-1, 4), None, _plain((1, 1, 1, 1))
    if visual.kind == "face":
        if smooth:
            raise ValueError("smooth must be False for a mesh with face colors")
        return np.repeat(np.asarray(visual.face_colors), 3, axis=0), None, _plain((1, 1, 1, 1))
    return None, None, _plain(_GREY)


def _plain(color: tuple[float, ...]) -> MetallicRoughnessMaterial:
    """Return the material of meshes that have none."""
    return MetallicRoughnessMaterial(
        alphaMode="BLEND", baseColorFactor=np.array(color, float), metallicFactor=_METALLIC,
        roughnessFactor=_ROUGHNESS,
    )  # fmt: skip


def _textured(material: Any) -> MetallicRoughnessMaterial:
    """Return a material of trimesh's, its exponent of Blinn-Phong turned into a roughness."""
    if isinstance(material, MetallicRoughnessMaterial):
        return material
    kind = type(material).__name__
    if kind == "PBRMaterial":
        names = (
            "normalTexture", "occlusionTexture", "emissiveTexture", "emissiveFactor",
            "baseColorFactor", "baseColorTexture", "metallicFactor", "roughnessFactor",
            "metallicRoughnessTexture", "alphaCutoff",
        )  # fmt: skip
        said = {name: getattr(material, name, None) for name in names}
        return MetallicRoughnessMaterial(
            alphaMode=material.alphaMode or "BLEND", doubleSided=bool(material.doubleSided), **said
        )
    if kind != "SimpleMaterial":
        return _plain(_GREY)
    exponent = material.kwargs.get("ns", material.kwargs.get("Ns", 1.0))
    exponent = float(np.ravel(exponent)[0])
    image = None if is_placeholder(material.image) else material.image
    # Walter et al. 2007: an exponent n is a width of sqrt(2 / (n + 2)), the roughness squared.
    roughness = np.sqrt(np.sqrt(2.0 / (max(exponent, 0.0) + 2.0)))
    return MetallicRoughnessMaterial(
        alphaMode="BLEND", roughnessFactor=float(roughness), baseColorTexture=image,
        baseColorFactor=np.asarray(material.diffuse),
    )  # fmt: skip


def _colors(value: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return colours of vertices, (V, 4) float64: bytes are shares of 255."""
    given = np.asarray(value)
    colors = given / 255.0 if given.dtype.kind in "iu" else given
    colors = np.tile(colors, (count, 1)) if colors.ndim == 1 else colors
    if colors.ndim != 2 or colors.shape[1] not in (3, 4):
        raise ValueError(f"color_0 must be (V, 3) or (V, 4), got {in_short(given)}")
    rgba = np.ones((count, 4))
    rgba[:, : colors.shape[1]] = finite_array("color_0", colors, (count, colors.shape[1]))
    return np.clip(rgba, 0.0, 1.0)
