"""Meshes: lists of primitives, each of one material."""

from __future__ import annotations

import copy
import math
from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.compat.pyrender.constants import GLTF
from rasterjit.compat.pyrender.fields import Field, keep_any, to_text_or_none
from rasterjit.compat.pyrender.material import Material, MetallicRoughnessMaterial
from rasterjit.compat.pyrender.primitive import Bounded, Primitive
from rasterjit.scene.validation import brief

if TYPE_CHECKING:
    import trimesh
    from trimesh.parent import Geometry

_DEFAULT_COLOR = (0.3, 0.3, 0.3, 1.0)
"""Base colour of meshes that have neither material nor colours."""

_DEFAULT_METALLIC, _DEFAULT_ROUGHNESS = 0.2, 0.8
"""Metallic and roughness factors of meshes that have no material."""


@dataclass(eq=False, repr=False)
class Mesh(Bounded):
    """
    Primitives that are placed together, by one node.

    Parameters
    ----------
    primitives : list of Primitive
        Not copied; it may be empty.
    name : str, optional
    weights : optional
        Of morph targets: kept and without effect.
    is_visible : bool
        Whether it is drawn.
    """

    primitives: Field[list[Primitive]] = Field(
        keep_any, "list of Primitive: the parts, each of one material.", MISSING
    )
    name: Field[str | None] = Field(to_text_or_none, "str or None: the mesh's name.", None)
    weights: Field[Any] = Field(keep_any, "As it was given: there are no morph targets.", None)
    is_visible: Field[bool] = Field(keep_any, "bool: whether it is drawn.", True)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64: least and largest coordinates; infinity and -infinity if it is empty."""
        bounds = np.array([[np.inf] * 3, [-np.inf] * 3])
        for primitive in self.primitives:
            low, high = primitive.bounds
            bounds = np.stack([np.minimum(bounds[0], low), np.maximum(bounds[1], high)])
        return bounds

    @property
    def is_transparent(self) -> bool:
        """Whether any of its primitives is transparent."""
        return any(primitive.is_transparent for primitive in self.primitives)

    @staticmethod
    def from_points(
        points: ArrayLike,
        colors: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        is_visible: bool = True,
        poses: ArrayLike | None = None,
    ) -> Mesh:
        """
        Return a mesh of points, drawn as squares of the renderer's ``point_size``, pixels.

        Parameters
        ----------
        points : (N, 3) array_like
        colors : (N, 3) or (N, 4) array_like, optional
            Floats in 0..1 or bytes.
        normals : (N, 3) array_like, optional
            Default: towards the camera.
        is_visible : bool
        poses : (M, 4, 4) array_like, optional
            Poses of its instances.

        Raises
        ------
        ValueError
            If an array has another shape, or is not one of numbers.
        """
        primitive = Primitive(
            points, normals=normals, color_0=colors, mode=GLTF.POINTS, poses=poses
        )
        return Mesh([primitive], is_visible=is_visible)

    @staticmethod
    def from_trimesh(
        mesh: Geometry | list[trimesh.Trimesh],
        material: Material | None = None,
        is_visible: bool = True,
        poses: ArrayLike | None = None,
        wireframe: bool = False,
        smooth: bool = True,
    ) -> Mesh:
        """
        Convert meshes of trimesh to one mesh, a primitive for each.

        Parameters
        ----------
        mesh : trimesh.Trimesh or list of them
            Its colours or its material and textures are used.
        material : Material, optional
            Replaces the mesh's colours and material.
        is_visible : bool
        poses : (N, 4, 4) array_like, optional
            Poses of its instances.
        wireframe : bool
            Whether its edges are drawn in place of its faces.
        smooth : bool
            Whether normals are interpolated; else faces are flat, as face colours need them.

        Raises
        ------
        TypeError
            If it is no ``trimesh.Trimesh``.
        ValueError
            If it has face colours and is smooth.
        """
        import trimesh

        parts = list(mesh) if isinstance(mesh, (list, tuple, set, np.ndarray)) else [mesh]
        primitives = []
        for part in parts:
            if not isinstance(part, trimesh.Trimesh):
                raise TypeError(f"mesh must be a trimesh.Trimesh or a list, got {brief(part)}")
            primitives.append(_convert_primitive(part, material, poses, wireframe, smooth))
        return Mesh(primitives, is_visible=is_visible)


def _convert_primitive(
    mesh: trimesh.Trimesh,
    material: Material | None,
    poses: ArrayLike | None,
    wireframe: bool,
    smooth: bool,
) -> Primitive:
    """Convert one mesh of trimesh to a primitive."""
    faces = np.asarray(mesh.faces)
    colors, uv, mesh_material = _convert_visual(mesh, smooth, has_material=material is not None)
    # A given material is copied for each primitive: users may change one of them.
    material = mesh_material if material is None else copy.deepcopy(material)
    material.wireframe = wireframe
    if smooth:
        positions, normals, indices = mesh.vertices, _compute_vertex_normals(mesh), faces
    else:
        positions = mesh.vertices[faces].reshape(-1, 3)
        normals, indices = np.repeat(mesh.face_normals, 3, axis=0), None
        uv = None if uv is None else uv[faces].reshape(-1, uv.shape[1])
    return Primitive(
        np.array(positions), normals=np.array(normals), texcoord_0=uv, color_0=colors,
        indices=indices, material=material, poses=poses,
    )  # fmt: skip


def _compute_vertex_normals(mesh: trimesh.Trimesh) -> NDArray[np.float64]:
    """
    Return a mesh's own vertex normals, (V, 3), else means of its faces' weighted by angle.

    The means are those of ``Trimesh.vertex_normals``, which needs SciPy for them. pyrender requires
    SciPy; here it may be missing, and trimesh then warns and compares each vertex with all faces.

    References
    ----------
    G. Thuermer and C. Wuethrich, "Computing Vertex Normals from Polygonal Facets", Journal of
    Graphics Tools 3 (1), 1998.
    """
    if not len(mesh.vertices):
        return np.zeros((0, 3))
    if "vertex_normals" not in mesh._cache:
        from trimesh.util import unitize

        faces = np.asarray(mesh.faces)
        # Faces without an area have normals of 0 and meaningless angles.
        weights = np.where(mesh.face_normals.any(axis=1)[:, None], mesh.face_angles, 0.0)
        corners = faces.ravel()
        sums = [
            np.bincount(corners, (weights * axis[:, None]).ravel(), minlength=len(mesh.vertices))
            for axis in mesh.face_normals.T
        ]
        mesh.vertex_normals = unitize(np.stack(sums, axis=1))
    return np.asarray(mesh.vertex_normals)


def _convert_visual(
    mesh: trimesh.Trimesh, smooth: bool, has_material: bool
) -> tuple[Any, Any, Any]:
    """Return vertex colours, texture coordinates of vertices, and the mesh's material, if used."""
    visual: Any = mesh.visual
    if not visual.defined:
        return None, None, _make_plain_material(_DEFAULT_COLOR)
    if visual.kind == "texture":
        uv = None if visual.uv is None else np.array(visual.uv)
        return None, uv, None if has_material else _convert_material(visual.material)
    if has_material or visual.kind not in ("vertex", "face"):
        return None, None, _make_plain_material(_DEFAULT_COLOR)
    if visual.kind == "vertex":
        colors = np.array(visual.vertex_colors)
        colors = colors if smooth else colors[mesh.faces].reshape(-1, colors.shape[1])
    elif smooth:
        raise ValueError("smooth must be False for a mesh with face colors, got True")
    else:
        colors = np.repeat(np.asarray(visual.face_colors), 3, axis=0)
    return colors, None, _make_plain_material((1.0, 1.0, 1.0, 1.0))


def _make_plain_material(color: tuple[float, ...]) -> MetallicRoughnessMaterial:
    """Return the material of meshes that have none, in a given base colour."""
    return MetallicRoughnessMaterial(
        alphaMode="BLEND", baseColorFactor=color, metallicFactor=_DEFAULT_METALLIC,
        roughnessFactor=_DEFAULT_ROUGHNESS,
    )  # fmt: skip


def _convert_material(material: Any) -> Material:
    """Convert a material of trimesh; the exponent of Blinn-Phong becomes a roughness."""
    if isinstance(material, MetallicRoughnessMaterial):
        return material
    kind = type(material).__name__
    if kind == "PBRMaterial":
        names = (
            "normalTexture", "occlusionTexture", "emissiveTexture", "emissiveFactor",
            "baseColorFactor", "baseColorTexture", "metallicFactor", "roughnessFactor",
            "metallicRoughnessTexture", "alphaCutoff",
        )  # fmt: skip
        fields: dict[str, Any] = {name: getattr(material, name, None) for name in names}
        return MetallicRoughnessMaterial(
            alphaMode="BLEND", doubleSided=bool(material.doubleSided), **fields
        )
    if kind != "SimpleMaterial":
        return _make_plain_material(_DEFAULT_COLOR)
    exponent = float(np.ravel(material.kwargs.get("Ns", 1.0))[0])
    # Walter et al. 2007: an exponent n is like a width of sqrt(2 / (n + 2)), the roughness squared.
    return MetallicRoughnessMaterial(
        alphaMode="BLEND", roughnessFactor=math.sqrt(math.sqrt(2.0 / (exponent + 2.0))),
        baseColorFactor=np.asarray(material.diffuse), baseColorTexture=material.image,
    )  # fmt: skip
