"""
Hold indexed triangle meshes, and show meshes and scenes in notebooks.

A mesh is checked once, when it is made, and shared by every scene that shows it. Notebooks show
meshes and scenes as small pictures.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Bool, Float32, Float64, HoldsArrays, Int32
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.color import ColorLike, linear_rows
from rasterjit.scene.colormap import ColormapLike
from rasterjit.scene.contours import ContoursLike
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.edge_twins import find_twins
from rasterjit.scene.first_corners import rotate_corners
from rasterjit.scene.hooks import call_higher_level
from rasterjit.scene.material import Material
from rasterjit.scene.norm import NormLike, RangeLike
from rasterjit.scene.normals import (
    TANGENT_GROUPS,
    compute_smooth_normals,
    is_creased,
    number_normal_groups,
    repair_normals,
    safe_scale,
    split_creases,
    unit_rows,
    vertex_tangents,
)
from rasterjit.scene.notebook_preview import PicturePreview
from rasterjit.scene.scalar_field import Field, make_field, refuse_field
from rasterjit.scene.skin import Deformable, MorphTargets, skin_arrays
from rasterjit.scene.texture import UV_NAMES, UVSet
from rasterjit.scene.warning import REPAIRED_NORMALS, warn_caller

if TYPE_CHECKING:
    import trimesh

_VERTICES_PER_CHUNK = 1 << 18
"""Vertices looked at at once where a temporary of the whole mesh would cost memory."""

ATTRIBUTE = "attribute:"
"""Prefix of the names of outputs that show an attribute of meshes."""

_MAX_FLOAT32 = float(np.finfo(np.float32).max)

Primitive: TypeAlias = Literal["triangles", "lines", "points"]

OnInvalid: TypeAlias = Literal["raise", "drop"]
ON_INVALID: tuple[OnInvalid, ...] = get_args(OnInvalid)
"""What to do about vertices that are NaN or infinite: refuse the mesh; leave out their faces."""


class Mesh(HoldsArrays, Guarded, PicturePreview):
    """
    Triangles that share vertices, with optional colours, normals and texture coordinates.

    A mesh owns its arrays: they are copied when it is made and read-only from then on, so that
    what was checked stays true. Another shape is another mesh.

    Parameters
    ----------
    vertices : (V, 3) array_like
        Model-space positions, in scene units.
    faces : (F, 3) array_like of int
        Vertex numbers, counter-clockwise seen from the front.
    colors : (V, 3|4) or (F, 3|4) array_like, optional
        Colour of each vertex or, with F rows, of each face (V rows win where V equals F). ``uint8``
        is sRGB; floats in 0..1 are linear light. They are drawn as given; a ``base_color`` that is
        given to the material multiplies them.
    normals : (V, 3) array_like, optional
        Model-space vertex normals of any length. One of length 0 becomes the average of the faces
        around its vertex, if it has any; if all are 0, none are given. Default: where they are
        needed, averages of the faces around each vertex, which round off sharp edges; see
        `split_creases`.
    uv : (V, 2) array_like, optional
        Texture coordinates.
    uv1 : (V, 2) array_like, optional
        Another set of them, for textures whose ``uv_set`` is 1.
    tangents : (V, 4) array_like, optional
        For normal maps: the model-space direction in which u grows, of any length, and 1 where v
        grows to the left of it seen from the front, -1 where to the right. Default: what ``uv``
        says.
    attributes : mapping of str to (V, D) or (F, D) array_like, optional
        Values of one's own by name, any D >= 1, stored as float32: of each vertex or, with F rows,
        of each face (V rows win where V equals F). ``outputs="attribute:heat"`` shows ``"heat"``.
    scalars : (V,) or (F,) array_like, optional
        A number for each vertex or, with F of them, of each face (V win where V equals F), shown by
        a colour map in the place of ``colors``. Those of vertices are interpolated over each face
        before the colour is looked up. NaN and infinity are allowed, and what NumPy masks is NaN;
        whole numbers and booleans are numbers. The output ``"scalar"`` has the values themselves,
        as float32. Lit surfaces are brighter or darker than the colour bar; ``Material("unlit")``
        shows its very colours.
    colormap : str, (N, 3|4) array_like, mapping or Colormap
        Which colours: see `Colormap`. Matplotlib's maps are taken as they are.
    range : (float, float) or str, optional
        The values of its first and its last colour; ``"2%"`` leaves out that share of the values at
        each end. Default: the least and the greatest scalar that is finite; (0, 1) if none is.
    norm : {"linear", "log", "symlog"}, ("symlog", float) or callable, optional
        How values are spread over the colours: evenly; their logarithms, where values from 0 down
        are NaN and the range is by default that of those above 0; logarithms of both signs, linear
        up to a size, by default 2. Or a norm of Matplotlib's, such as ``LogNorm()``,
        ``TwoSlopeNorm(0)`` or ``BoundaryNorm(...)``, whose limits are the range if it has any; it
        must not fall, and is asked once, for the value at which each colour begins.
    nan_color : colour, optional
        Of faces that are NaN or infinite, or have a corner that is. Default: the colour map's, or
        a dark grey.
    contours : int, (N,) array_like or Contours, optional
        Lines along which scalars of vertices have one value: how many inside the range, which
        values, or `Contours`, which has their width and colour too.
    material : Material, optional
        Default ``Material()``.
    joints : (V, K) array_like of int, optional
        Which joints of a node's `Skin` each vertex follows, by their numbers; any K >= 1. Without a
        skin the mesh is in its bind pose.
    weights : (V, K) array_like, optional
        How much it follows each, at least 0. Those of a vertex are scaled to a sum of 1 where it is
        not that but for rounding.
    morph_targets : MorphTargets, optional
        Shapes that it can be drawn towards.
    on_invalid : {"raise", "drop"}
        What to do about NaN or infinite vertices: refuse the mesh, or keep its arrays as they are
        for the renderer to leave out the faces that touch one.

    Attributes
    ----------
    invalid_vertices : int
        Number of vertices with a NaN or infinite coordinate; above 0 only after ``"drop"``.

    Raises
    ------
    ValueError
        If an array has the wrong shape or type or is empty, a face points outside the vertices, a
        value is NaN or infinite where it may not be, no vertex is finite, both ``colors`` and
        ``scalars`` are given, ``joints`` without ``weights``, weights of a vertex that are all 0,
        or targets for another number of vertices.
    AttributeError
        If anything else than ``material`` and ``variants`` is assigned.

    Warns
    -----
    UserWarning
        If normals have length 0 and are made from the faces, naming how many.
    """

    primitive: ClassVar[Primitive] = "triangles"
    """Kind of its faces."""

    _FIELDS = ("material", "variants")
    _ADVICE = "make another Mesh"
    _VERTEX_WORDS: ClassVar[tuple[str, str]] = "vertices", "vertex"
    """Words of messages for its vertices, and for one."""
    _DEFAULT_MATERIAL: ClassVar[Material | None] = None
    """Material if none is given; the colours of scalars replace its colour."""
    # Most meshes have none of them, and take no room for that.
    _joints: Int32 | None = None
    _joint_weights: Float64 | None = None
    _morph_targets: MorphTargets | None = None
    _normal_groups: Int32 | None = None
    """(V,): numbers of groups of vertices that share a normal, in place of given normals."""
    _rest_mesh: Mesh | None = None
    """The undeformed mesh that a posed one was made of."""
    _drawn_faces: Int32 | None = None
    _edge_twins: Int32 | None = None
    """Cached faces in the order of corners in which they are drawn."""
    _all_used: bool | None = None
    """Whether all vertices are finite and belong to a face; None: not computed."""
    _is_in_world: bool = False
    """Whether a skin has put it into world space."""
    _skin_source: tuple[Mesh, Float64] | None = None
    """The mesh that a skin deformed, and the matrices, (J, 4, 4), of its joints."""

    _repaired_normals: int = 0
    """Number of normals of length 0 that were replaced by those of the faces."""

    _variants: tuple[tuple[str, Material], ...] = ()
    _default_material: Material | None = None
    """The material without a variant, while one is shown."""

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        colors: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        uv: ArrayLike | None = None,
        uv1: ArrayLike | None = None,
        tangents: ArrayLike | None = None,
        attributes: Mapping[str, ArrayLike] | None = None,
        scalars: ArrayLike | None = None,
        colormap: ColormapLike = "viridis",
        range: RangeLike | None = None,
        norm: NormLike | None = None,
        nan_color: ColorLike | None = None,
        contours: ContoursLike | None = None,
        joints: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        morph_targets: MorphTargets | None = None,
        material: Material | None = None,
        on_invalid: OnInvalid = "raise",
    ) -> None:
        # Geometry.
        check.one_of("on_invalid", on_invalid, ON_INVALID)
        self._vertices = check.read_only(_check_vertices(self._VERTEX_WORDS[0], vertices))
        self._faces = check.read_only(self._face_array(faces))
        self._invalid_vertices = _count_invalid(self._VERTEX_WORDS, self._vertices, on_invalid)
        self._bounds: tuple[Float64, Float64] | None = None
        # Colours, given or by scalars.
        self._vertex_colors: Float32 | None = None
        self._face_colors: Float32 | None = None
        if colors is not None:
            self._store_colors(colors)
        self._field: Field | None = None
        if scalars is not None:
            if colors is not None:
                raise ValueError(
                    "colors must be None where scalars are given, which have their own"
                )
            counts = self._scalar_counts()
            self._field = make_field(scalars, counts, colormap, range, norm, nan_color, contours)
            if self._field.of_faces:
                self._face_colors = check.read_only(self._field.colors())
        else:
            refuse_field(
                colormap=colormap, range=range, norm=norm, nan_color=nan_color, contours=contours
            )
        # Normals, texture coordinates and tangents.
        self._normals: Float32 | None = None
        if normals is not None:
            self._store_normals(_check_normals(normals, len(self._vertices)))
        self._uv: Float32 | None = None
        if uv is not None:
            self._uv = check.read_only(_check_uv("uv", uv, len(self._vertices)))
        self._uv1: Float32 | None = None
        if uv1 is not None:
            self._uv1 = check.read_only(_check_uv("uv1", uv1, len(self._vertices)))
        self._tangents: Float32 | None = None
        if tangents is not None:
            self._tangents = check.read_only(_check_tangents(tangents, len(self._vertices)))
        # Attributes of one's own, joints and morph targets.
        self._vertex_attributes: dict[str, Float32] = {}
        self._face_attributes: dict[str, Float32] = {}
        if attributes is not None:
            self._store_attributes(attributes)
        if joints is not None or weights is not None or morph_targets is not None:
            self._store_deformation(joints, weights, morph_targets)
        # How it is shaded.
        self.material = Material() if material is None else material
        self._vertex_normals: Float32 | None = self.normals
        self._is_closed: bool | None = None

    @property
    def vertices(self) -> Float64:
        """(V, 3) float64, C order, read-only: model-space positions."""
        return self._vertices

    @property
    def faces(self) -> Int32:
        """(F, 3) int32, C order, read-only: vertex numbers."""
        return self._faces

    @property
    def vertex_colors(self) -> Float32 | None:
        """(V, 4) float32, read-only: linear RGBA, or None."""
        return self._vertex_colors

    @property
    def face_colors(self) -> Float32 | None:
        """(F, 4) float32, read-only: linear RGBA, or None."""
        return self._face_colors

    @property
    def field(self) -> Field | None:
        """The scalars and how they are shown, or None; those of faces are ``face_colors`` too."""
        return self._field

    @property
    def vertex_field(self) -> Field | None:
        """The scalars if they are those of vertices, or None."""
        return None if self._field is None or self._field.of_faces else self._field

    @property
    def normals(self) -> Float32 | None:
        """(V, 3) float32, read-only: the given normals, of unit or zero length, or None."""
        return self._normals

    @property
    def uv(self) -> Float32 | None:
        """(V, 2) float32, read-only: texture coordinates, or None."""
        return self._uv

    @property
    def uv1(self) -> Float32 | None:
        """(V, 2) float32, read-only: another set of texture coordinates, or None."""
        return self._uv1

    @property
    def uv_sets(self) -> tuple[Float32 | None, Float32 | None]:
        """``uv`` and ``uv1``, as ``uv_set`` of a `Texture` numbers them."""
        return self._uv, self._uv1

    @property
    def tangents(self) -> Float32 | None:
        """(V, 4) float32, read-only: given tangents, of unit or zero length, and sides, or None."""
        return self._tangents

    @property
    def vertex_attributes(self) -> Mapping[str, Float32]:
        """Values of one's own of the vertices, by name: (V, D) float32, read-only."""
        return MappingProxyType(self._vertex_attributes)

    @property
    def face_attributes(self) -> Mapping[str, Float32]:
        """Values of one's own of the faces, by name: (F, D) float32, read-only."""
        return MappingProxyType(self._face_attributes)

    @property
    def joints(self) -> Int32 | None:
        """(V, K) int32, read-only: which joints of a skin each vertex follows, or None."""
        return self._joints

    @property
    def weights(self) -> Float64 | None:
        """(V, K) float64, read-only: how much it follows each, or None."""
        return self._joint_weights

    @property
    def morph_targets(self) -> MorphTargets | None:
        """Shapes that the mesh can be drawn towards, or None."""
        return self._morph_targets

    @property
    def material(self) -> Material:
        """
        How the surface is shaded; another may be assigned, and is of no variant then.

        It multiplies the colours of `Points` and `Lines`, says how points are lit, and is unlit for
        lines.
        """
        return self._material

    @material.setter
    def material(self, value: Material) -> None:
        self._check_material("material", value)
        self._material, self._default_material = value, None

    @staticmethod
    def _check_material(name: str, value: Any) -> None:
        """Raise ``ValueError`` if a mesh of this kind cannot have a material."""
        check.instance_of(name, value, Material)

    @property
    def variants(self) -> Mapping[str, Material]:
        """
        Other materials, by the names of variants; another mapping may be assigned.

        `Scene.variant` says which is shown, when it is assigned; meshes without one of that name
        show their own.
        """
        return MappingProxyType(dict(self._variants))

    @variants.setter
    def variants(self, value: Mapping[str, Material]) -> None:
        if not isinstance(value, Mapping):
            raise ValueError(
                f"variants must be a mapping of names to materials, got {check.brief(value)}"
            )
        for name, material in value.items():
            if not isinstance(name, str) or not name:
                raise ValueError(f"variants must have texts as names, got {check.brief(name)}")
            self._check_material(f"variants[{name!r}]", material)
        self._variants = tuple(value.items())

    @property
    def default_material(self) -> Material:
        """The material that is shown without a variant."""
        return self._material if self._default_material is None else self._default_material

    def show_variant(self, name: str | None) -> None:
        """
        Show the material of a variant, or the mesh's own if it has none of that name.

        Parameters
        ----------
        name : str or None
            None for the mesh's own.
        """
        chosen = None if name is None else dict(self._variants).get(check.string("name", name))
        default = self.default_material
        self._default_material = None if chosen is None else default
        self._material = default if chosen is None else chosen

    @property
    def invalid_vertices(self) -> int:
        """Number of vertices with a NaN or infinite coordinate."""
        return self._invalid_vertices

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Fill a copy, or what was pickled; its arrays are read-only too."""
        super().__setstate__(state)
        if self._joints is not None or self._morph_targets is not None:
            Deformable.any_made = True

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.faces)} faces)"

    def _face_array(self, faces: Any) -> Int32:
        """Return the faces, (F, 3) int32, checked."""
        return face_array(faces, len(self._vertices))

    def _store_colors(self, colors: ArrayLike) -> None:
        """Store colours by vertex or by face, as their number of rows tells."""
        rgba = check.read_only(np.array(linear_rows("colors", colors)))
        if len(rgba) == len(self.vertices):
            self._vertex_colors = rgba
        elif len(rgba) == len(self.faces):
            self._face_colors = rgba
        else:
            raise ValueError(
                f"colors must have one row per vertex ({len(self.vertices)}) or per face "
                f"({len(self.faces)}), got {len(rgba)}"
            )

    def _store_attributes(self, attributes: Mapping[str, ArrayLike]) -> None:
        """Store attributes by vertex or by face, as their numbers of rows tell."""
        if not isinstance(attributes, Mapping):
            raise ValueError(
                f"attributes must be a mapping of names to arrays, got {check.brief(attributes)}"
            )
        for name, value in attributes.items():
            if not isinstance(name, str) or not name:
                raise ValueError(f"attributes must have texts as names, got {check.brief(name)}")
            values = check.read_only(value_rows(f"attributes[{name!r}]", value))
            if len(values) == len(self.vertices):
                self._vertex_attributes[name] = values
            elif len(values) == len(self.faces):
                self._face_attributes[name] = values
            else:
                raise ValueError(
                    f"attributes[{name!r}] must have one row per vertex ({len(self.vertices)}) or "
                    f"per face ({len(self.faces)}), got {len(values)}"
                )

    def _store_normals(self, normals: Float32) -> None:
        """Store unit normals, those of length 0 replaced with a warning; or none if all are 0."""
        is_given = bool(normals.any())
        if self.primitive == "triangles" and not normals.any(axis=1).all():
            normals = self._repair_normals(normals, self, repr(self))
        if is_given or self.primitive != "triangles":
            self._normals = check.read_only(normals)

    def _repair_normals(self, normals: Float32, rest: Mesh, label: str) -> Float32:
        """Return normals with those of length 0 computed; warn of them once for each rest mesh."""
        scale = self._coordinate_scale()
        normals, count = repair_normals(normals, self.vertices, self.faces, scale)
        if count and not rest._repaired_normals:
            rest._repaired_normals = count
            noun = "normal of length 0" if count == 1 else "normals of length 0"
            warn_caller(
                f"{count:,} {noun} of {label}: made from the faces around", kind=REPAIRED_NORMALS
            )
        return normals

    def _store_deformation(self, joints: Any, weights: Any, targets: Any) -> None:
        """Check and store joints, weights and morph targets."""
        if joints is not None or weights is not None:
            self._joints, self._joint_weights = skin_arrays(joints, weights, len(self.vertices))
        if targets is not None:
            check.instance_of("morph_targets", targets, MorphTargets)
            if targets.vertex_count != len(self.vertices):
                raise ValueError(
                    f"morph_targets must be for {len(self.vertices)} vertices, got targets for "
                    f"{targets.vertex_count}"
                )
            self._morph_targets = targets
        Deformable.any_made = True

    def used_vertices(self) -> Bool:
        """Mark the vertices, (V,) bool, that are finite and belong to a face."""
        used = np.zeros(len(self.vertices), dtype=bool)
        used[self.faces.ravel()] = True
        if self.invalid_vertices:
            used &= np.isfinite(self.vertices).all(axis=1)
        return used

    def bounds(self) -> tuple[Float64, Float64]:
        """
        Return the smallest axis-parallel box around the mesh.

        Returns
        -------
        low, high : (3,) float64
            Model-space corners, over the finite vertices that belong to a face.

        Raises
        ------
        ValueError
            If no face has a finite vertex.
        """
        if self._bounds is None:
            used = self.used_vertices()
            if not used.any():
                raise ValueError("mesh has no face with a finite vertex, so it has no bounds")
            mask = used[:, np.newaxis]
            self._bounds = (
                self.vertices.min(axis=0, where=mask, initial=np.inf),
                self.vertices.max(axis=0, where=mask, initial=-np.inf),
            )
        return self._bounds[0].copy(), self._bounds[1].copy()

    def _faces_to_draw(self) -> Int32:
        """Return the faces, triangles rotated to begin with their least corner at rest; cached."""
        if self.primitive != "triangles":
            return self.faces
        rest = self if self._rest_mesh is None else self._rest_mesh
        if rest._drawn_faces is None:
            rest._drawn_faces = check.read_only(rotate_corners(rest.vertices, rest.faces))
        return rest._drawn_faces

    def _twins_to_draw(self) -> Int32:
        """Return the twins of the sides of the faces to draw, by their places at rest; cached."""
        rest = self if self._rest_mesh is None else self._rest_mesh
        if rest._edge_twins is None:
            rest._edge_twins = check.read_only(find_twins(rest.vertices, rest._faces_to_draw()))
        return rest._edge_twins

    def is_closed(self) -> bool:
        """
        Tell whether the mesh is watertight: each edge belongs to an even number of faces.

        Vertices at the same place are one, whichever way faces turn. Points and lines never do.
        Cached.
        """
        if self.primitive != "triangles":
            return False
        if self._is_closed is None:
            self._is_closed = _is_watertight(self.vertices[self.faces])
        return self._is_closed

    def vertex_normals(self) -> Float32:
        """
        Return the given normals, or averages over the faces around each vertex by area.

        Returns
        -------
        (V, 3) float32
            Model-space unit normals, cached; zero where no face with an area touches the vertex.

        Warns
        -----
        UserWarning
            If the averages round off the sharp edges of a mesh that has many, as a box.
        """
        if self._vertex_normals is None and self.primitive != "triangles":
            self._vertex_normals = check.read_only(np.zeros((len(self.vertices), 3), np.float32))
        if self._vertex_normals is None:
            self._vertex_normals = check.read_only(self._derive_normals())
            # The rest mesh of a posed one was warned of, or is not creased.
            if self._rest_mesh is None and is_creased(
                self.vertices, self.faces, self._coordinate_scale()
            ):
                warn_caller(
                    f"sharp edges are rounded off: {self!r} was given no normals, and those made "
                    "for it are averages across its edges; draw mesh.split_creases(), shade it "
                    "'flat', or give it normals"
                )
        return self._vertex_normals

    @property
    def _derives_normals(self) -> bool:
        """Whether normals are computed from the faces in each pose."""
        return self._normals is None or self._normal_groups is not None

    def _derive_normals(self) -> Float32:
        """Compute the normals from the faces, (V, 3)."""
        return compute_smooth_normals(
            self.vertices, self.faces, self._coordinate_scale(), self._normal_groups
        )

    def vertex_tangents(
        self, transform: tuple[float, ...] | None = None, uv_set: UVSet = 0
    ) -> Float32:
        """
        Return the given tangents, or compute them from texture coordinates.

        Parameters
        ----------
        transform : six floats, optional
            What `Texture.transform` makes of them; given tangents stay as they are.
        uv_set : {0, 1}
            Which coordinates: ``uv`` or ``uv1``.

        Returns
        -------
        (V, 2, 4) float32
            For each group of faces, those whose texture runs the same way round and those where it
            is mirrored, a unit vector in model space, zero where no face of the group has one, and
            the side: 1 or -1. Both groups are the same where tangents are given.

        Raises
        ------
        ValueError
            If the mesh has neither.
        """
        if transform is not None:
            transform = tuple(check.finite_array("transform", transform, (6,)).tolist())
        uv = self.uv_sets[check.one_of("uv_set", uv_set, (0, 1))]
        if self.tangents is not None:
            return np.repeat(self.tangents[:, np.newaxis], TANGENT_GROUPS, axis=1)
        if uv is None:
            name = UV_NAMES[uv_set]
            raise ValueError(f"mesh must have {name} or tangents to have tangents, got neither")
        return vertex_tangents(self.vertices, self.faces, uv, self._coordinate_scale(), transform)

    def split_creases(self, angle: float = 40.0) -> Mesh:
        """
        Return the mesh with sharp edges sharp and curved surfaces smooth.

        Every corner of a face gets the average, by area, of the normals of the faces around its
        position that lie within ``angle`` of the normal of its own face. Positions are the same
        when their coordinates are the same bits, whatever vertex they belong to, so the seams of
        a texture and the loose triangles of an STL file are smooth too. Vertices are duplicated
        where their corners differ, and merged if they carry neither colours nor texture coordinates
        nor ``tangents`` nor attributes nor scalars, nor can be posed.

        Parameters
        ----------
        angle : float
            Crease angle, degrees in 0..180: 0 keeps faces flat, 180 smooths everything.

        Returns
        -------
        Mesh
            The same faces in the same order, with ``normals``; old ``normals`` are not used.

        Raises
        ------
        ValueError
            If the angle lies outside 0..180 or is not finite.
        """
        angle = check.finite_number("angle", angle)
        if not 0.0 <= angle <= 180.0:
            raise ValueError(f"angle must lie in 0..180 degrees, got {angle!r}")
        vertex_data = self.vertex_colors, *self.uv_sets, self.tangents, self.vertex_field
        can_be_posed = self._joints is not None or self._morph_targets is not None
        is_plain = all(values is None for values in vertex_data) and not self._vertex_attributes
        is_plain = is_plain and not can_be_posed
        split = split_creases(
            self.vertices, self.faces, self._coordinate_scale(), angle, merge=is_plain
        )

        # The arrays come from a checked mesh: fill the new one without checking them again.
        def picked(values: Any) -> Any:
            return None if values is None else check.read_only(values[split.sources])

        attributes, field = self._vertex_attributes, self.vertex_field
        result = Mesh.__new__(Mesh)
        result.__dict__.update(
            _vertices=picked(self.vertices), _faces=check.read_only(np.array(split.faces)),
            _vertex_colors=picked(self.vertex_colors), _face_colors=self.face_colors,
            _field=self.field if field is None else field.select_rows(split.sources),
            _uv=picked(self.uv), _uv1=picked(self.uv1), _tangents=picked(self.tangents),
            _vertex_attributes={name: picked(values) for name, values in attributes.items()},
            _face_attributes=self._face_attributes, _material=self.material,
            _variants=self._variants, _default_material=self._default_material,
            _bounds=self._bounds, _is_closed=self._is_closed,
        )  # fmt: skip
        result._normals = result._vertex_normals = check.read_only(split.normals)
        result._invalid_vertices = _count_invalid(self._VERTEX_WORDS, result.vertices, "drop")
        if can_be_posed:
            result._copy_deformation(self, split.sources)
            result._normal_groups = check.read_only(
                number_normal_groups(result.vertices, split.normals)
            )
        return result

    def _alias(self) -> Mesh:
        """Return a mesh that shares the attribute dictionary, but does not keep this one alive."""
        alias = object.__new__(type(self))
        alias.__dict__ = self.__dict__
        return alias

    def _copy_deformation(self, other: Mesh, sources: NDArray[np.integer]) -> None:
        """Copy joints, weights and morph targets of the vertices, (V,) indices, of another mesh."""
        if other._joints is not None and other._joint_weights is not None:
            self._joints = check.read_only(other._joints[sources])
            self._joint_weights = check.read_only(other._joint_weights[sources])
        if other._morph_targets is not None:
            self._morph_targets = other._morph_targets.of_vertices(sources)

    def to_trimesh(self) -> trimesh.Trimesh:
        """
        Return a ``trimesh.Trimesh`` of the same vertices and faces, in the same order.

        `Points` become a ``trimesh.PointCloud`` and `Lines` a ``trimesh.path.Path3D``.

        It has the normals that are in force, colours as bytes in sRGB, ``uv`` and attributes. A
        material becomes ``PBRMaterial`` or, of Blinn-Phong, ``SimpleMaterial``, with pictures of
        8 bits.

        Warns
        -----
        SaveWarning
            Once, naming what trimesh has no place for.
        """
        return call_higher_level("to_trimesh", self)

    def shown_vertex_colors(self) -> Float32 | None:
        """Return colours of the vertices, (V, 4) linear RGBA, or of their scalars, or None."""
        return self.vertex_colors if self.vertex_field is None else self.vertex_field.colors()

    def with_scalars(
        self,
        scalars: str | ArrayLike,
        colormap: ColormapLike = "viridis",
        *,
        range: RangeLike | None = None,
        norm: NormLike | None = None,
        nan_color: ColorLike | None = None,
        contours: ContoursLike | None = None,
    ) -> Mesh:
        """
        Return the same mesh, shown by a colour map in the place of its colours.

        Parameters
        ----------
        scalars : str, (V,) or (F,) array_like
            The name of one of its attributes that has one column, of vertices or else of faces; or
            the numbers themselves.
        colormap, range, norm, nan_color, contours
            As a `Mesh` takes them; `Points` and `Lines` have no contours.

        Raises
        ------
        ValueError
            Naming the argument that is wrong; if there is no such attribute, with those there are.

        Examples
        --------
        >>> import numpy as np, rasterjit as rj
        >>> mesh = rj.Mesh(np.eye(3), [[0, 1, 2]], attributes={"heat": [[20.0], [30.0], [25.0]]})
        >>> frame = rj.render(mesh.with_scalars("heat", "inferno", contours=5), size=(64, 48))
        """
        if contours is not None and self.primitive != "triangles":
            raise ValueError(
                f"contours must be None for {self.primitive}, which have no slopes; "
                f"got {check.short_repr(contours)}"
            )
        counts = self._scalar_counts()
        if isinstance(scalars, str):
            scalars, is_of_faces = self._scalar_attribute(scalars)
            # Where there are as many vertices as faces, the number of rows does not tell.
            counts = (-1, counts[1]) if is_of_faces else counts
        result = self.without_colors()
        if result._material == self._DEFAULT_MATERIAL:
            result._material = replace(result._material, base_color=None)
        result._field = make_field(scalars, counts, colormap, range, norm, nan_color, contours)
        if result._field.of_faces:
            result._face_colors = check.read_only(result._field.colors())
        return result

    def warp(self, displacements: str | ArrayLike, scale: float = 1.0) -> Mesh:
        """
        Return the mesh with its vertices moved, such as a part as it deforms under load.

        Normals are averages over the faces around each vertex; those of `Points` stay. Skins and
        morph targets, which move vertices themselves, are not taken over.

        Parameters
        ----------
        displacements : str, (V, 3) or (V,) array_like
            How far each vertex moves, model space, scene units; with one number a vertex, along its
            normal. Or the name of an attribute of vertices that holds them.
        scale : float
            What they are multiplied by, to be seen.

        Raises
        ------
        ValueError
            If they are neither, or not finite.

        Examples
        --------
        >>> import rasterjit as rj
        >>> mesh = rj.load("models/torus_knot.obj").nodes[0].mesh
        >>> bent = mesh.warp(mesh.vertices[:, 1], scale=0.1)
        """
        moves: Any = displacements
        if isinstance(displacements, str):
            # Those of points are kept as those of faces.
            is_points = self.primitive == "points"
            attributes = self._face_attributes if is_points else self._vertex_attributes
            check.one_of("displacements", displacements, (*attributes,))
            moves = attributes[displacements]
        rows = len(self.vertices)
        moves = check.number_array("displacements", moves)
        if moves.shape in ((rows,), (rows, 1)):
            if self.primitive != "triangles" and self.normals is None:
                raise ValueError(
                    f"displacements must have three numbers a vertex for {self.primitive} without "
                    f"normals, got shape {moves.shape}"
                )
            moves = moves.reshape(rows, 1) * self.vertex_normals()
        moves = check.finite_array("displacements", moves, (rows, 3))
        return replace_vertices(self, self.vertices + check.finite_number("scale", scale) * moves)

    def _scalar_counts(self) -> tuple[int, int]:
        """Return the number of vertices and of faces, each of which may have scalars."""
        return len(self._vertices), len(self._faces)

    @property
    def scalar_attributes(self) -> tuple[str, ...]:
        """Names of the attributes that have one column, those of vertices first."""
        attributes = (*self._vertex_attributes.items(), *self._face_attributes.items())
        return tuple(dict.fromkeys(name for name, values in attributes if values.shape[1] == 1))

    def _scalar_attribute(self, name: str) -> tuple[Float32, bool]:
        """Return an attribute of one column, and whether it belongs to faces, or raise."""
        for of_faces, attributes in enumerate((self._vertex_attributes, self._face_attributes)):
            if name in attributes and attributes[name].shape[1] == 1:
                return attributes[name], bool(of_faces)
        names = self.scalar_attributes
        available = f"it has {', '.join(map(repr, names))}" if names else "it has none"
        raise ValueError(
            f"scalars must be numbers, or the name of an attribute of one column: {available}; got "
            f"{check.brief(name)}{check.suggest(name, names)}"
        )

    def without_colors(self) -> Mesh:
        """Return the same mesh without vertex and face colours and scalars."""
        result = copy.copy(self)
        result._vertex_colors = result._face_colors = result._field = None
        return result

    def _coordinate_scale(self) -> float:
        """Return the factor that keeps products of this mesh's coordinates in range."""
        try:
            return safe_scale(*self.bounds())
        except ValueError:
            return 1.0


def _is_watertight(corners: Float64) -> bool:
    """Tell whether each edge belongs to an even number of the faces, corners (F, 3, 3)."""
    if not np.isfinite(corners).all():
        return False
    indices, _ = distinct_rows(*corners.reshape(-1, 3).T)
    ends = indices.reshape(-1, 3)
    next_ends = np.roll(ends, -1, axis=1)
    first, last = np.minimum(ends, next_ends), np.maximum(ends, next_ends)
    _, counts = np.unique((first * ends.size + last)[first < last], return_counts=True)
    return not (counts % 2).any()


def _check_numbers(name: str, value: ArrayLike, kinds: str, shape: tuple[int | None, int]) -> Any:
    """Return ``value`` as an array of the given dtype kinds and shape, or raise ``ValueError``."""
    # The base class also for subclasses such as trimesh's tracked arrays.
    array = check.unmasked_array(name, value, *check.ROWS_WORDING)
    rows, columns = shape
    wanted = f"({'n' if rows is None else rows}, {columns})"
    if array.size == 0:
        raise ValueError(f"there are no {name}: {name} must have shape {wanted}, got {array.shape}")
    if array.dtype.kind not in kinds:
        raise ValueError(f"{name} must hold numbers, got an array of dtype {array.dtype}")
    if array.ndim != 2 or array.shape[1] != columns or rows not in (None, array.shape[0]):
        raise ValueError(f"{name} must have shape {wanted}, got {array.shape}")
    return array


def value_rows(name: str, value: ArrayLike) -> Float32:
    """Return a copy of values as finite (N, D) float32, C order, or raise ``ValueError``."""
    array = check.unmasked_array(name, value, "an array of numbers")
    if array.dtype.kind not in "uif":
        raise ValueError(f"{name} must hold numbers, got an array of dtype {array.dtype}")
    if array.ndim != 2 or array.size == 0:
        hint = "; reshape(-1, 1) makes one column of it" if array.ndim == 1 else ""
        raise ValueError(f"{name} must have shape (n, D), D >= 1, got {array.shape}{hint}")
    low, high = float(array.min()), float(array.max())
    if not (np.isfinite(low) and np.isfinite(high)):
        count = int((~np.isfinite(array)).any(axis=1).sum())
        raise ValueError(f"{name} must be finite, got {count} rows with NaN or infinity")
    if max(-low, high) > _MAX_FLOAT32:
        raise ValueError(f"{name} must fit float32, got {max(-low, high)!r} in size")
    return np.array(array, dtype=np.float32, order="C")


def _check_vertices(name: str, value: ArrayLike) -> Float64:
    """Return vertices as (V, 3) float64, a copy in C order, or raise ``ValueError``."""
    numbers = _check_numbers(name, value, "uif", (None, 3))
    with np.errstate(over="ignore"):  # Beyond float64 is infinite, and counted as such.
        return np.array(numbers, dtype=np.float64, order="C")


def face_array(value: ArrayLike, vertex_count: int) -> Int32:
    """Return a copy of faces, (F, 3) int32, C order, that all point at vertices, or raise."""
    return index_rows(("faces", "vertices"), value, vertex_count, 3)


def index_rows(names: tuple[str, str], value: ArrayLike, count: int, columns: int) -> Int32:
    """
    Return a copy of rows of indices, (N, columns) int32, C order, or raise ``ValueError``.

    Parameters
    ----------
    names : (str, str)
        What messages call the rows, and what they point at.
    value : (N, columns) array_like
    count : int
        How many things there are to point at.
    columns : int
    """
    name, targets = names
    array = _check_numbers(name, value, "uif", (None, columns))
    low, high = array.min(), array.max()
    target = "vertex" if targets == "vertices" else "point"
    if array.dtype.kind == "f" and not (
        np.isfinite(low) and np.isfinite(high) and (array == np.trunc(array)).all()
    ):
        example = array[~(np.isfinite(array) & (array == np.trunc(array)))][0].item()
        raise ValueError(f"{name} must hold whole {target} numbers, got {example!r}")
    if low < 0:
        negative = int((array < 0).sum())
        raise ValueError(
            f"{name} must hold {target} numbers from 0, got {negative} below, down to {low}"
        )
    if high >= count:
        outside = int((array >= count).any(axis=1).sum())
        raise ValueError(
            f"{name} must point at the {count} {targets} (0..{count - 1}), got {outside} of "
            f"{len(array)} {name} past the end, the largest index being {int(high)}"
        )
    return np.array(array, dtype=np.int32, order="C")


def _count_invalid(names: tuple[str, str], vertices: Float64, on_invalid: str) -> int:
    """Count the vertices that are not finite; raise ``ValueError`` where they may not be."""
    if np.isfinite(vertices.min()) and np.isfinite(vertices.max()):
        return 0
    finite = np.isfinite(vertices).all(axis=1)
    count = len(vertices) - int(finite.sum())
    if on_invalid == "raise":
        first = int(np.argmin(finite))
        raise ValueError(
            f"{names[0]} must be finite, got {count} of {len(vertices)} with NaN or infinity, the "
            f"first being {names[1]} {first}: {vertices[first].tolist()}; on_invalid='drop' leaves "
            "out what touches one"
        )
    return count


def _check_vertex_rows(name: str, value: ArrayLike, shape: tuple[int, int]) -> NDArray[Any]:
    """Return one finite row per vertex, or raise ``ValueError``."""
    array = _check_numbers(name, value, "uif", shape)
    if not (np.isfinite(array.min()) and np.isfinite(array.max())):
        count = int((~np.isfinite(array).all(axis=1)).sum())
        raise ValueError(f"{name} must be finite, got {count} rows with NaN or infinity")
    return array


def _check_uv(name: str, value: ArrayLike, vertex_count: int) -> Float32:
    """Return texture coordinates as (V, 2) float32, or raise ``ValueError``."""
    array = _check_vertex_rows(name, value, (vertex_count, 2))
    largest = max(-float(array.min()), float(array.max()))
    if largest > _MAX_FLOAT32:
        raise ValueError(f"{name} must fit float32, got {largest!r} in size")
    return np.array(array, dtype=np.float32, order="C")


def _check_normals(value: ArrayLike, vertex_count: int) -> Float32:
    """Return normals as (V, 3) float32 of unit or zero length, or raise ``ValueError``."""
    array = _check_vertex_rows("normals", value, (vertex_count, 3))
    normals = np.empty((vertex_count, 3), dtype=np.float32)
    for start in range(0, vertex_count, _VERTICES_PER_CHUNK):
        rows = slice(start, start + _VERTICES_PER_CHUNK)
        normals[rows] = unit_rows(array[rows].astype(np.float64))
    return normals


def _check_tangents(value: ArrayLike, vertex_count: int) -> Float32:
    """Return tangents as (V, 4) float32: of unit or zero length, and a side; or raise."""
    array = _check_vertex_rows("tangents", value, (vertex_count, 4)).astype(np.float64)
    tangents = np.empty((vertex_count, 4), dtype=np.float32)
    tangents[:, :3] = unit_rows(array[:, :3])
    tangents[:, 3] = np.where(array[:, 3] < 0.0, -1.0, 1.0)
    return tangents


def copy_field(mesh: Mesh, other: Mesh) -> Mesh:
    """Copy the scalars of a mesh of as many vertices and faces to a new mesh; return it."""
    mesh._field = other.field
    return mesh


def replace_scalars(mesh: Mesh, values: Float64) -> Mesh:
    """Return a mesh with other scalars in the place of its own, as many, by the same scale."""
    assert mesh.field is not None
    field = replace(mesh.field, values=check.read_only(np.array(values, np.float64)))
    colors = {"_face_colors": check.read_only(field.colors())} if field.of_faces else {}
    return mesh._with(_field=field, **colors)


def replace_vertices(mesh: Mesh, vertices: Float64) -> Mesh:
    """Return a mesh of the same class with other vertices, as many, and normals of that shape."""
    moved = Mesh(
        vertices, mesh.faces, colors=mesh.vertex_colors, uv=mesh.uv, uv1=mesh.uv1,
        attributes=mesh.vertex_attributes, material=mesh.material,
    )  # fmt: skip
    if mesh.primitive != "triangles":
        moved._normals = moved._vertex_normals = mesh.normals
    copy_field(moved, mesh)
    set_face_values(moved, mesh.face_colors, mesh.face_attributes)
    # Keep what classes have beside what a Mesh has, such as sizes.
    own = {name: value for name, value in mesh.__dict__.items() if not hasattr(Mesh, name)}
    result = object.__new__(type(mesh))
    result.__dict__.update(own | moved.__dict__)
    return result


def set_face_scalars(mesh: Mesh, scalars: ArrayLike) -> Mesh:
    """Set a scalar for each face, (F,), of a new mesh with any number of vertices; return it."""
    mesh._field = make_field(scalars, (-1, len(mesh.faces)), "viridis", None, None, None, None)
    mesh._face_colors = check.read_only(mesh._field.colors())
    return mesh


def set_face_values(mesh: Mesh, colors: Float32 | None, attributes: Mapping[str, Float32]) -> Mesh:
    """
    Set the face colours and attributes of a new mesh with any number of vertices; return it.

    Parameters
    ----------
    mesh : Mesh
    colors : (F, 4) float32, linear RGBA, or None
    attributes : mapping of str to (F, D) float32
        Both as a checked mesh has them.
    """
    mesh._face_colors = colors
    mesh._face_attributes = {name: check.read_only(values) for name, values in attributes.items()}
    return mesh
