"""
The records that cross from the caller into the kernels; an effect keeps its own.

Each is a ``NamedTuple`` of arrays and numbers. No kernel is given ``None``: where a field is
``None``, the stages that would read it are not in the list. Letters: V vertices, E vertices made
by clipping, F faces, P pieces made by clipping, O objects, L lights.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rasterjit.runtime.state import float32, float64, int8, int32, int64, uint8


class Viewport(NamedTuple):
    """
    Where normalized device coordinates land, and on which grid.

    A picture may be a part of a larger one: its vertices are snapped as the whole would snap them,
    then moved by whole pixels, so that every integer that follows is the one of the whole picture.

    ``subpixel_bits`` is the grid that vertices are rounded to, ``grid_bits`` the grid that their
    coordinates are counted on. They are the same but for 0 sub-pixel bits, where a second unit per
    pixel is needed to name a pixel's centre.
    """

    width: int64
    """W, pixels."""
    height: int64
    """H, pixels."""
    guard_x: float64
    """Guard band: ``|x| <= guard_x * w`` holds for every vertex that is snapped."""
    guard_y: float64
    """Guard band in y."""
    subpixel_bits: int64
    """Vertices are rounded to multiples of ``2**-subpixel_bits`` pixel."""
    grid_bits: int64
    """Screen coordinates are integers in units of ``2**-grid_bits`` pixel."""
    reach: int64 = 0
    """How far around a pixel's centre its samples may lie, in those units; 0: there is one sample,
    at the centre."""
    left: int64 = 0
    """Columns of the whole picture before the first of this part."""
    top: int64 = 0
    """Rows of the whole picture above this part."""
    right: int64 = 0
    """Columns of the whole picture behind the last of this part."""
    bottom: int64 = 0
    """Rows of the whole picture below this part."""
    spacing: float64 = 1.0
    """How far apart the samples lie that are shaded by themselves, pixels: 1, but for the pictures
    that a supersampled frame is the mean of; a power of two, so that it rounds nothing."""


class ScreenVertices(NamedTuple):
    """
    Vertices on the sub-pixel grid: those of the meshes, then those made by clipping.

    One that is outside the guard band has an outcode only.
    """

    xy: int32[:, :]
    """(V+E, 2) int32, screen, units of ``2**-grid_bits`` pixel."""
    depth: float64[:]
    """(V+E,) float64, stored depth: greater is nearer."""
    codes: uint8[:]
    """(V+E,) uint8, outcodes (see ``setup``)."""
    w: float64[:]
    """(V+E,) float64, clip space."""


class Faces(NamedTuple):
    """The faces of all objects, and the pieces that stand in for those that were clipped."""

    faces: int32[:, ::1]
    """(F, 3) int32, vertex numbers."""
    pieces: int32[:, ::1]
    """(P, 3) int32, vertex numbers of the pieces, grouped by source face."""
    piece_faces: int32[::1]
    """(P,) int32, the face that each piece was cut from, ascending."""


class Objects(NamedTuple):
    """Which faces belong to which object, and which way its front faces turn."""

    face_starts: int64[::1]
    """(O+1,) int64: object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""
    culled_turns: int8[::1]
    """(O,) int8: faces that turn this way on the screen are dropped: +1, -1, or 0 for none."""


class Geometry(NamedTuple):
    """What it takes to find where on a face a sample lies."""

    faces: int32[:, ::1]
    """(F, 3) int32, vertex numbers."""
    xy: int32[:, :]
    """(V+E, 2) int32, snapped screen positions."""
    codes: uint8[:]
    """(V+E,) uint8, outcodes."""
    w: float64[:]
    """(V+E,) float64, clip space | (0,): faces that were not clipped are interpolated on the
    screen."""
    clip_positions: float64[:, ::1]
    """(V, 4) float64 | (0, 4) if no vertex has a ``CLIPPED`` code and nothing else reads them."""
    viewport: Viewport


class Placement(NamedTuple):
    """Where the objects stand, relative to the eye so that nothing is lost far from the origin."""

    face_starts: int64[::1]
    """(O+1,) int64: object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""
    positions: float64[:, ::1]
    """(V, 3) float64, model space."""
    relative_from_model: float64[:, :, :]
    """(O, 3, 4) float64: world axes, origin at the eye."""
    normal_matrices: float64[:, :, :]
    """(O, 3, 3) float64: model normals to world axes, up to length."""
    mirrored: float64[::1]
    """(O,) float64: -1 where the transform turns faces inside out, else 1."""
    front_turns: float64[::1]
    """(O,) float64: sign of the edge function of an object's front faces on the screen."""
    toward_viewer: float64[::1]
    """(4,) float64: a point p, relative to the eye, is seen along ``xyz - w p``."""


class Textures(NamedTuple):
    """
    The textures of all objects, each with its mip levels.

    K kinds of texture: for the base colour, for normals ... ``textures.CORE_KINDS``, or all
    ``textures.KINDS``.
    """

    texels: float32[:, ::1]
    """(N, 4) float32, linear RGBA: level by level, row by row from the top; see ``mip_levels``."""
    levels: int64[:, ::1]
    """(M, 3) int64: first texel, width, height."""
    table: int64[:, :, ::1]
    """
    (O, K, 7) int64: first level or -1 for none, levels, wrap in u, in v, filter, anisotropy, alpha.

    The last is what alpha does to texels: ``textures.PLAIN`` ...
    """
    uv: float32[:, ::1]
    """(V, 2) float32; v runs up. Those of base colours; ``Maps.coordinates`` has others."""
    transforms: float64[:, :, ::1]
    """(O, K, 6) float64, ``u' = t0 u + t1 v + t2, v' = t3 u + t4 v + t5`` | (0, K, 6): all
    as is."""


class AlphaTests(NamedTuple):
    """What leaves out holes: a sample whose alpha is below the cutoff is not covered."""

    cutoffs: float32[::1]
    """(O,) float32; 0 for an object without holes."""
    face_starts: int64[::1]
    """(O+1,) int64: object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""
    materials: float32[:, ::1]
    """(O, 7) float32, as ``Surface.materials``."""
    vertex_colors: float32[:, ::1]
    """(V, 4) float32 | (0, 4): their alpha is 1."""
    face_colors: float32[:, ::1]
    """(F, 4) float32 | (0, 4): their alpha is 1."""
    textures: Textures
    """With a table of no rows: their alpha is 1."""
    geometry: Geometry = None
    """Of the picture that is drawn; None as long as its vertices are not on the screen."""


UNLIT, FLAT, GOURAUD, PHONG, PBR = 0, 1, 2, 3, 4
"""Shading models, as ``Surface.materials`` numbers them."""

MATERIAL_SPECULAR, MATERIAL_SHININESS, MATERIAL_MODEL = 4, 5, 6
"""Columns of ``Surface.materials`` behind the base colour."""


class Alphas(NamedTuple):
    """Which objects have an alpha of their own: that of material, colours and texture."""

    is_blended: Any
    """(O,) uint8: 1 where what lies behind an object is seen through it."""


class Maps(NamedTuple):
    """What textures and factors give the objects besides a base colour: see ``surface.maps``."""

    factors: Any
    """(O, 5) float32: normal scale, occlusion strength, emitted red, green, blue (linear)."""
    counts: Any
    """(14,) int64, number of objects with a texture of each kind, as ``textures`` numbers them."""
    tangents: Any
    """(V, 2, 4) float32, model space: where u grows, and the sign of where v does, for faces whose
    texture is not mirrored and for those where it is; (0, 2, 4) if no object has a normal map."""
    coordinates: Any
    """Of each kind of texture: (V, 2) float32 | None -> those of ``Textures.uv``."""


class Levels(NamedTuple):
    """The iso-lines of the scalars of all objects: see ``surface.contours``."""

    levels: Any
    """(N,) float64: those of each object, ascending."""
    places: Any
    """(O, 2) int64: the first of an object's levels, and how many it has."""
    lines: Any
    """(O, 4) float32: half the width of lines, pixels; red, green, blue, linear."""


class Fields(NamedTuple):
    """The scalars of all objects' vertices, and how they are shown: see ``surface.fields``."""

    values: Any
    """(V,) float64."""
    rules: Any
    """(O, 2) float64: the value of the first entry, and what those above are divided by."""
    entries: Any
    """(O, 2) int64: first row of ``colors`` and number of entries; 0 entries: it has none."""
    colors: Any
    """(N, 4) float32, linear RGBA: the entries of each map, and the colour of NaN behind them."""
    contours: Levels | None = None
    """None -> no object has iso-lines."""


class Microfacets(NamedTuple):
    """The metallic-roughness materials of all objects."""

    factors: Any
    """(O, 2) float32: metallic, roughness."""
    parts: Any
    """(2,) float32: how much of the light that goes into a surface is shown, and of that mirrored;
    1 and 1, but for who asks for one of them alone."""


class Layers(NamedTuple):
    """What glTF's extensions lay over the objects; a kind that no object in view has is None."""

    coats: Any
    """(O, 10) float32: rows from COAT on, see ``surface.samples``."""
    coat_scales: Any
    """(O, 1) float32: factor on x and y of the varnish's normals."""
    coat_tangents: Any
    """As ``Maps.tangents``, for the normal maps of varnish."""
    sheens: Any
    """(O, 4) float32: red, green, blue, roughness."""
    dielectrics: Any
    """(O, 5) float32: rows from HEAD_ON_RED on."""
    stand_ins: Any
    """(O, 9) float32: rows from LAYER_RED on of a white mirror, lit where an object is by
    microfacets."""
    albedo: Any
    """``lighting.sheen.ALBEDO`` as an array."""


IOR, MIRRORED, EDGE, INSIDE, PER_DISTANCE = 0, 1, 2, 3, 6
"""Columns of ``Through.factors``: MIRRORED is the share of light straight on that is mirrored, EDGE
a factor on all that is; INSIDE, three, the colour that light has which went through the body for a
distance, PER_DISTANCE one over that."""


class Through(NamedTuple):
    """How light goes through the objects."""

    rows: Any
    """(O, 2) float32: transmission; thickness in units of the mesh."""
    factors: Any
    """(O, 7) float32: columns from IOR on."""


class Surface(NamedTuple):
    """What the objects look like."""

    materials: Any
    """(O, 7) float32: red, green, blue, alpha (linear), specular, shininess, shading model."""
    vertex_colors: Any
    """(V, 4) float32, linear | None -> material colour alone."""
    face_colors: Any
    """(F, 4) float32, linear | None -> material colour alone."""
    normals: Any
    """(V, 3) float32, model space | None -> no smooth shading."""
    lit_vertices: Any
    """(V, 2, 3) float32, light on the front and the back of a vertex | None -> no Gouraud."""
    diffuse_vertices: Any
    """(V, 2, 3) float32, without highlights | None -> none over face colours or textures."""
    textures: Textures | None
    """None -> no object has a texture."""
    maps: Maps | None = None
    """What else lies over the objects (normal maps, emission ...) | None -> nothing."""
    alphas: Alphas | None = None
    """What it takes to find the alpha of a sample | None -> all are opaque."""
    microfacets: Microfacets | None = None
    """Metallic-roughness materials | None -> none."""
    fields: Fields | None = None
    """Scalars of vertices | None -> none."""
    points: Any = None
    """The points in view, and how lines of sight run: ``points.PointsSeen.read`` | None ->
    none."""
    in_float32: Any = None
    """(O,) uint8: 1 where an object shows colours of its vertices that are mixed in float32 | None
    -> none does."""
    through: Through | None = None
    """How light goes through the objects | None -> through none in view."""
    layers: Layers | None = None
    """Varnish, fibres, own mirrors | None -> none in view."""


class Imitated(NamedTuple):
    """What pyrender's shader is given of each object."""

    taken: Any
    """(O, L) uint8: 1 where a light falls on an object."""
    faces_viewer: Any
    """(O,) uint8: 1 where normals point to the viewer | None -> nowhere."""
    are_squares: Any = None
    """(O,) uint8: 1 where two triangles stand for a point each | None -> nowhere."""
    gains: Any = None
    """(O, 6) float32: factors on base colours and on those of vertices | None -> all are 1."""
    maps: Any = ()
    """Of each light with a shadow map: its row, ``view_of_light`` and the map, see
    ``lighting.pyrender``."""


class Lighting(NamedTuple):
    """The light that falls on the scene."""

    lights: Any
    """
    (L, 13) float32: x, y, z, w, red, green, blue; light comes along ``xyz - w p``. Then cone and
    range, see ``lighting.blinn_phong``: axis x, y, z, scale, offset, ending.
    """
    ambient: Any
    """(3,) float32, linear."""
    highlights: Any
    """Number of objects with a specular highlight | None -> none."""
    renormalizes: int = 1
    """Not 0: interpolated normals are scaled to length one; 0: they are taken as they are."""
    imitated: Imitated | None = None
    """What else pyrender's shader is given, see ``lighting.pyrender`` | None -> it is not
    imitated."""
