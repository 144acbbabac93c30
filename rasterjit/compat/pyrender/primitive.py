"""Primitives: triangles, lines or points of one material."""

from __future__ import annotations

import abc
import copy
from dataclasses import MISSING, dataclass, field
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.compat.pyrender.constants import GLTF, BufFlags
from rasterjit.compat.pyrender.fields import Field, OwnedField, keep_any
from rasterjit.compat.pyrender.material import Material, MetallicRoughnessMaterial
from rasterjit.compat.pyrender.utils import format_color_array
from rasterjit.scene.material import Material as SceneMaterial
from rasterjit.scene.mesh import Mesh as SceneMesh
from rasterjit.scene.validation import brief, read_only
from rasterjit.scene.warning import REPAIRED_NORMALS, silence_warnings

Float32 = NDArray[np.float32]

_MAX_EXACT_INTEGER = 1 << 24
"""Largest whole number up to which all are exact in float32."""


def _check_material(value: Material | None) -> Material:
    """Return a material; the default one for None."""
    if value is not None and not isinstance(value, Material):
        raise TypeError(f"must be a Material, got {brief(value)}")
    return MetallicRoughnessMaterial() if value is None else value


class Bounded(abc.ABC):
    """What has bounds: their middle, sides and diagonal, in the precision of these."""

    @property
    @abc.abstractmethod
    def bounds(self) -> NDArray[Any]:
        """(2, 3) float: least and largest coordinates."""

    @property
    def centroid(self) -> NDArray[Any]:
        """(3,) float: the middle of its bounds."""
        low, high = self.bounds
        return (low + high) / 2.0

    @property
    def extents(self) -> NDArray[Any]:
        """(3,) float: the sides of its bounds."""
        low, high = self.bounds
        return high - low

    @property
    def scale(self) -> Any:
        """The diagonal of its bounds."""
        extents = self.extents
        return np.sqrt((extents * extents).sum())


@dataclass(eq=False, repr=False)
class Primitive(Bounded):
    """
    Triangles, lines or points of one material.

    Arrays are kept as float32. What was drawn is kept until an array is set; numbers that are
    changed inside an array after that are not seen.

    Parameters
    ----------
    positions : (V, 3) array_like
    normals : (V, 3) array_like, optional
        Default: those of the surface.
    tangents : (V, 4) array_like, optional
        Kept and without effect.
    texcoord_0 : (V, 2) array_like, optional
        Texture coordinates.
    texcoord_1 : (V, 2) array_like, optional
        Kept and without effect.
    color_0 : (V, 3) or (V, 4) array_like, or one colour, optional
        Floats in 0..1 or whole numbers in 0..255; they multiply what the material shows.
    joints_0, weights_0, targets : optional
        Kept and without effect.
    indices : (M,) or (F, 3) array_like of int, optional
        Vertices in the order of drawing; default: one after the other.
    material : Material, optional
    mode : int
        ``GLTF.TRIANGLES`` or another of the seven from ``GLTF.POINTS`` to ``GLTF.TRIANGLE_FAN``.
    poses : (N, 4, 4) or (4, 4) array_like, optional
        Where instances of it stand, relative to the node.

    Raises
    ------
    TypeError
        If the material is none.
    ValueError
        If an array is no such thing, or the mode is unknown.
    """

    _drawn: dict[Any, Any] = field(init=False)
    # What was made of it, by what it was made for.
    _bounds: Float32 | None = field(init=False)

    def _check_positions(self, value: ArrayLike) -> Float32:
        """Return positions as float32, (n, 3)."""
        self._clear_cache()
        given = _to_floats(value)
        if given.ndim != 2 or given.shape[1] != 3:
            raise ValueError(f"must have shape (n, 3), got {given.shape}")
        return given

    def _check_indices(self, value: ArrayLike | None) -> NDArray[Any] | None:
        """Return vertex numbers as pyrender stores them: float32, float64 if that is not exact."""
        self._clear_cache()
        if value is None:
            return None
        given = np.asarray(value)
        if given.dtype.kind not in "buif":
            raise ValueError(f"must be whole numbers, got {brief(given)}")
        is_large = given.size > 0 and given.max() > _MAX_EXACT_INTEGER
        return np.ascontiguousarray(given, np.float64 if is_large else np.float32)

    def _check_mode(self, value: int | None) -> int:
        """Return the code of a mode of primitives; None is triangles."""
        self._clear_cache()
        mode = GLTF.TRIANGLES if value is None else int(value)
        if not GLTF.POINTS <= mode <= GLTF.TRIANGLE_FAN:
            raise ValueError(f"must be in 0..6, from GLTF.POINTS on, got {mode}")
        return mode

    def _check_poses(self, value: ArrayLike | None) -> Float32 | None:
        """Return the poses of instances as float32, (n, 4, 4)."""
        self._clear_cache()
        if value is None:
            return None
        given = _to_floats(value)
        given = given[None] if given.ndim == 2 else given
        if given.ndim != 3 or given.shape[1:] != (4, 4):
            raise ValueError(f"must have shape (n, 4, 4), got {given.shape}")
        return given

    def _check_vertex_rows(self, value: ArrayLike | None, width: int) -> Float32 | None:
        """Return an array as float32 with a row for each vertex."""
        self._clear_cache()
        if value is None:
            return None
        array, count = _to_floats(value), len(self.positions)
        if array.shape != (count, width):
            raise ValueError(f"must have shape ({count}, {width}), got {array.shape}")
        return array

    def _check_uv(self, value: ArrayLike | None) -> Float32 | None:
        """Return texture coordinates as float32, without columns beyond the second."""
        given = None if value is None else np.asarray(value)
        return self._check_vertex_rows(
            given[:, :2] if given is not None and given.ndim == 2 else given, 2
        )

    def _check_colors(self, value: ArrayLike | None) -> Float32 | None:
        """Return colours as float32, (V, 4)."""
        shape = len(self.positions), 4
        return self._check_vertex_rows(
            None if value is None else format_color_array(value, shape), 4
        )

    positions: Field[Float32] = OwnedField(
        _check_positions, "(V, 3) float32: positions of the vertices.", MISSING
    )
    normals: Field[Float32 | None] = OwnedField(
        lambda self, value: self._check_vertex_rows(value, 3),
        "(V, 3) float32, or None: normals of the vertices.",
        None,
    )
    tangents: Field[Float32 | None] = OwnedField(
        lambda self, value: self._check_vertex_rows(value, 4),
        "(V, 4) float32, or None: as they were given.",
        None,
    )
    texcoord_0: Field[Float32 | None] = OwnedField(
        _check_uv, "(V, 2) float32, or None: texture coordinates of the vertices.", None
    )
    texcoord_1: Field[Float32 | None] = OwnedField(
        lambda self, value: self._check_vertex_rows(value, 2),
        "(V, 2) float32, or None: as they were given.",
        None,
    )
    color_0: Field[Float32 | None] = OwnedField(
        _check_colors, "(V, 4) float32, or None: colours of the vertices.", None
    )
    joints_0: Field[Any] = Field(keep_any, "As it was given: nothing here has skins.", None)
    weights_0: Field[Any] = Field(keep_any, "As it was given: nothing here has skins.", None)
    indices: Field[NDArray[Any] | None] = OwnedField(
        _check_indices,
        "Vertices in the order of drawing, or None; of the shape they were given in.",
        None,
    )
    material: Field[Material] = Field(_check_material, "Material: never None.", None)
    mode: Field[int] = OwnedField(
        _check_mode,
        "int: what is drawn, a code of `GLTF` from ``POINTS`` to ``TRIANGLE_FAN``.",
        None,
    )
    targets: Field[Any] = Field(keep_any, "As it was given: nothing here changes shape.", None)
    poses: Field[Float32 | None] = OwnedField(
        _check_poses,
        "(N, 4, 4) float32, or None: where instances stand, relative to the node.",
        None,
    )

    @property
    def bounds(self) -> Float32:
        """
        (2, 3) float32: least and largest coordinates; of nothing, infinity and -infinity.

        As in pyrender, instances count as if they were moved and not turned.
        """
        if self._bounds is None:
            points = self.positions
            low, high = np.full(3, np.inf, np.float32), np.full(3, -np.inf, np.float32)
            if len(points):
                low, high = points.min(axis=0), points.max(axis=0)
            if self.poses is not None and len(self.poses):
                places = self.poses[:, :3, 3]
                low, high = low + places.min(axis=0), high + places.max(axis=0)
            self._bounds = np.stack([low, high])
        return self._bounds

    @property
    def buf_flags(self) -> int:
        """Which arrays it has, as ``BufFlags`` numbers them."""
        arrays = {
            BufFlags.NORMAL: self.normals,
            BufFlags.TANGENT: self.tangents,
            BufFlags.TEXCOORD_0: self.texcoord_0,
            BufFlags.TEXCOORD_1: self.texcoord_1,
            BufFlags.COLOR_0: self.color_0,
            BufFlags.JOINTS_0: self.joints_0,
            BufFlags.WEIGHTS_0: self.weights_0,
        }
        return int(sum(flag for flag, array in arrays.items() if array is not None))

    @property
    def is_transparent(self) -> bool:
        """Whether its material is, or any vertex."""
        has_alpha = self.color_0 is not None and bool((self.color_0[:, 3] != 1.0).any())
        return self.material.is_transparent or has_alpha

    def delete(self) -> None:
        """Release the cached meshes."""
        self._clear_cache()

    @property
    def least_alpha(self) -> float:
        """The least alpha of any vertex, in 0..1."""
        if self.color_0 is None or not len(self.color_0):
            return 1.0
        return min(max(float(self.color_0[:, 3].min()), 0.0), 1.0)

    @property
    def is_empty(self) -> bool:
        """Whether it has nothing to draw: no vertices, or too few for a triangle."""
        count = len(self.positions) if self.indices is None else self.indices.size
        return not len(self.positions) or count < (3 if self.mode >= GLTF.TRIANGLES else 1)

    def list_vertices(self) -> NDArray[np.int64]:
        """Return the vertex numbers in the order of drawing, (M,) int64."""
        if self.indices is None:
            return np.arange(len(self.positions))
        return self.indices.reshape(-1).astype(np.int64)

    def list_faces(self) -> NDArray[np.int64]:
        """
        Return the triangles, (F, 3) int64; none for lines and points.

        Vertices of a last, incomplete triangle are dropped. All triangles of a strip have the
        winding of its first one.
        """
        order = self.list_vertices()
        if self.mode == GLTF.TRIANGLES:
            return order[: len(order) // 3 * 3].reshape(-1, 3)
        if self.mode == GLTF.TRIANGLE_STRIP and len(order) >= 3:
            faces = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
            faces[1::2, :2] = faces[1::2, 1::-1]
            return faces
        if self.mode == GLTF.TRIANGLE_FAN and len(order) >= 3:
            first = np.full(len(order) - 2, order[0])
            return np.stack([first, order[1:-1], order[2:]], axis=1)
        return np.zeros((0, 3), np.int64)

    def convert(self, is_lit: bool, look: SceneMaterial, is_turned: bool = False) -> SceneMesh:
        """
        Convert the triangles to a mesh of RasterJIT's, cached as long as the material is the same.

        Parameters
        ----------
        is_lit : bool
            Whether light is computed.
        look : Material
        is_turned : bool
            Whether to reverse the winding of faces.
        """
        key = is_lit, is_turned, look.shading
        if key not in self._drawn:
            faces = self.list_faces()
            # pyrender does not warn of normals of length 0.
            with silence_warnings(REPAIRED_NORMALS):
                self._drawn[key] = made = SceneMesh(
                    self.positions, faces[:, ::-1] if is_turned else faces,
                    normals=zero_nonfinite(self.normals), uv=zero_nonfinite(self.texcoord_0),
                    colors=self.get_colors(is_lit), material=look, on_invalid="drop",
                )  # fmt: skip
            if self.normals is None:
                # Set as given normals, they cause no warning of sharp edges.
                made._normals = made._vertex_normals = read_only(made._derive_normals())
            if is_lit:
                # Computed now, so that copies share them.
                made.vertex_normals()
        if self._drawn[key].material != look:
            # A copy, as scenes drawn before keep the old material.
            self._drawn[key] = copy.copy(self._drawn[key])
            self._drawn[key].material = look
        return self._drawn[key]

    @property
    def fades(self) -> bool:
        """Whether its alpha is below 1 anywhere, whatever its material's mode."""
        return self.least_alpha * self.material.least_alpha < 1.0

    def show_alpha(self) -> Primitive:
        """Return the primitive with its alpha as unlit grey, in all channels."""
        material = self.material
        color, texture = material._get_base()
        cached = self._drawn.get("alphas")
        if cached is None or cached[0] is not texture or not np.array_equal(cached[1], color):
            grey = copy.copy(self)
            if self.color_0 is not None:
                grey.color_0 = np.repeat(self.color_0[:, 3:], 4, axis=1)
            grey_texture = None if texture is None else texture.show_alpha()
            cached = self._drawn["alphas"] = texture, color.copy(), grey, grey_texture
        _, _, grey, grey_texture = cached
        grey.material = MetallicRoughnessMaterial(
            alphaMode=material.alphaMode, doubleSided=material.doubleSided,
            wireframe=material.wireframe, baseColorFactor=np.repeat(color[3], 4),
            baseColorTexture=grey_texture,
        )  # fmt: skip
        return grey

    def get_colors(self, is_lit: bool) -> NDArray[np.float64] | None:
        """
        Return the vertex colours, (V, 4) float64 in 0..1: factors on light, or unlit on codes.

        Lit ones are divided by the gain of their channel; see `compute_gains`.
        """
        if self.color_0 is None:
            return None
        colors = zero_nonfinite(self.color_0).astype(np.float64)
        if is_lit:
            colors[:, :3] /= self.compute_gains()[3:]
        return np.clip(colors, 0.0, 1.0)

    def compute_gains(self) -> NDArray[np.float32]:
        """Return the part above 1 of lit base and vertex colours, as factors, (6,) from 1 on."""
        base, _ = self.material._get_base()
        gains = np.ones(6, np.float32)
        gains[:3] = np.fmax(base[:3], 1.0)
        if self.color_0 is not None and len(self.color_0):
            color_gains = self._drawn.get("gains")
            if color_gains is None:
                maximum = zero_nonfinite(self.color_0)[:, :3].max(axis=0)
                color_gains = self._drawn["gains"] = np.maximum(maximum, 1.0)
            gains[3:] = color_gains
        return gains

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to copy and pickle, without the cached meshes."""
        return {**self.__dict__, "_drawn": {}}

    def _clear_cache(self) -> None:
        """Drop the cached meshes and bounds."""
        self._drawn = {}
        self._bounds = None


@overload
def zero_nonfinite(array: None) -> None: ...


@overload
def zero_nonfinite(array: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]: ...


def zero_nonfinite(array: NDArray[np.floating[Any]] | None) -> NDArray[np.floating[Any]] | None:
    """Return an array with 0 in place of NaN and infinity; the same array if it has none."""
    if array is None or not array.size or (np.isfinite(array.min()) and np.isfinite(array.max())):
        return array
    return np.nan_to_num(array, nan=0.0, posinf=0.0, neginf=0.0)


def _to_floats(value: ArrayLike) -> Float32:
    """Return numbers as float32 in rows, or raise ``ValueError``."""
    try:
        return np.ascontiguousarray(value, np.float32)
    except (TypeError, ValueError):
        raise ValueError(f"must be an array of numbers, got {brief(value)}") from None
