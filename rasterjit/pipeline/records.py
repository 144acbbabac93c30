"""
Define the records (named tuples of arrays) passed to kernels; effects define their own.

Each is a ``NamedTuple`` of arrays and numbers. No kernel is given ``None``: where a field is
``None``, the stages that would read it are not in the list. Letters: V vertices, E vertices made
by clipping, F faces, P pieces made by clipping, O objects, L lights.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rasterjit.runtime.state_block import float32, float64, int8, int32, int64, uint8, uint32


class Viewport(NamedTuple):
    """
    The viewport transform from NDC to pixels, the sub-pixel grid and the guard band.

    A picture may be a part of a larger one: vertices are snapped as in the whole, then shifted by
    whole pixels, so that all derived integers are those of the whole picture.

    ``subpixel_bits`` is the grid that vertices are rounded to, ``grid_bits`` the unit of their
    coordinates. They are equal except for 0 sub-pixel bits, where a pixel's centre needs a second
    unit per pixel.
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
    sample_radius: int64 = 0
    """Largest distance of samples from pixel centres, in x or y, sub-pixel units; 0: centred."""
    left: int64 = 0
    """Columns of the whole picture before the first of this part."""
    top: int64 = 0
    """Rows of the whole picture above this part."""
    right: int64 = 0
    """Columns of the whole picture after the last of this part."""
    bottom: int64 = 0
    """Rows of the whole picture below this part."""
    spacing: float64 = 1.0
    """Distance between shaded samples, pixels: 1, less in the pictures that a supersampled frame
    averages; a power of two, so that it rounds nothing."""


class ScreenVertices(NamedTuple):
    """
    Vertices on the sub-pixel grid: vertices of meshes, then those made by clipping.

    A vertex outside the guard band has only an outcode.
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
    """The faces of all objects, and the pieces that replace clipped ones."""

    faces: int32[:, ::1]
    """(F, 3) int32, vertex numbers."""
    pieces: int32[:, ::1]
    """(P, 3) int32, vertex numbers of the pieces, grouped by source face."""
    piece_faces: int32[::1]
    """(P,) int32, the clipped face of each piece, ascending."""


class Objects(NamedTuple):
    """The faces of each object, and the winding that is culled."""

    face_starts: int64[::1]
    """(O+1,) int64: object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""
    culled_windings: int8[::1]
    """(O,) int8: faces of this winding on the screen are culled: +1, -1, or 0 for none."""


class Geometry(NamedTuple):
    """Projected geometry: inputs for the barycentric weights of samples."""

    faces: int32[:, ::1]
    """(F, 3) int32, vertex numbers."""
    xy: int32[:, :]
    """(V+E, 2) int32, snapped screen positions."""
    codes: uint8[:]
    """(V+E,) uint8, outcodes."""
    w: float64[:]
    """(V+E,) float64, clip space | (0,): affine interpolation on faces that were not clipped."""
    clip_positions: float64[:, ::1]
    """(V, 4) float64 | (0, 4) if no vertex has a ``CLIPPED`` code and nothing else reads them."""
    viewport: Viewport


class Placement(NamedTuple):
    """The objects' transforms, relative to the eye for precision far from the origin."""

    face_starts: int64[::1]
    """(O+1,) int64: object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""
    positions: float64[:, ::1]
    """(V, 3) float64, model space."""
    relative_from_model: float64[:, :, :]
    """(O, 3, 4) float64: world axes, origin at the eye."""
    normal_matrices: float64[:, :, :]
    """(O, 3, 3) float64: model normals to world axes, up to length."""
    mirrored: float64[::1]
    """(O,) float64: -1 where the transform mirrors, else 1."""
    front_windings: float64[::1]
    """(O,) float64: sign of the edge function of an object's front faces on the screen."""
    toward_viewer: float64[::1]
    """(4,) float64: the viewer lies along ``xyz - w p`` from a point p, relative to the eye."""


class Textures(NamedTuple):
    """
    The textures of all objects, each with its mip levels.

    K kinds of texture: for the base colour, for normals ... ``texture_filters.CORE_KINDS``, or all
    ``texture_filters.KINDS``.
    """

    texels: float32[:, ::1]
    """(N, 4) float32, linear RGBA: level by level, row by row from the top; see ``mip_levels``."""
    codes: uint8[::1]
    """(B,) uint8: level 0 of pictures of codes, 1 to 4 to a texel: grey or colours, then alpha."""
    curves: float32[:, ::1]
    """(3, 256) float32: the linear value of each code, in rows ``texture_filters.SRGB`` ..."""
    levels: int64[:, ::1]
    """
    (M, 3) int64: first texel, width, height.

    A level 0 of codes has the texel indices just before the next level's.
    """
    table: int64[:, :, ::1]
    """
    (O, K, 10) int64: first level or -1 for none, levels, wrap in u, in v, filter, anisotropy, what
    alpha does to texels (``texture_filters.PLAIN`` ...); channels of codes, or 0 if all levels are
    floats; the first code; the curve of colours.
    """
    uv: float32[:, ::1]
    """(V, 2) float32; v runs up. For base colours; ``Maps.coordinates`` has other kinds'."""
    transforms: float64[:, :, ::1]
    """(O, K, 6) float64, ``u' = t0 u + t1 v + t2, v' = t3 u + t4 v + t5`` | (0, K, 6):
    identities."""


class CodedTextures(NamedTuple):
    """The base colours' textures of objects that show nothing else, as 8-bit sRGB codes."""

    texels: uint32[::1]
    """(N,) uint32, red in the lowest byte: row by row from the top."""
    table: int64[:, ::1]
    """
    (O, 7) int64: first texel, or -1 for an object whose textures are read as light; width; height;
    wrap in u, in v; filter; code of the base colour.
    """
    transforms: float64[:, ::1]
    """(O, 6) float64, as a row of ``Textures.transforms``."""


class AlphaTests(NamedTuple):
    """Inputs of the alpha test: a sample whose alpha is below the cutoff is discarded."""

    cutoffs: float32[::1]
    """(O,) float32; 0 for an object without alpha test."""
    face_starts: int64[::1]
    """(O+1,) int64: object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""
    materials: float32[:, ::1]
    """(O, 7) float32, as ``Surface.materials``."""
    vertex_colors: float32[:, ::1]
    """(V, 4) float32 | (0, 4): alpha 1."""
    face_colors: float32[:, ::1]
    """(F, 4) float32 | (0, 4): alpha 1."""
    textures: Textures
    """With a table of no rows: alpha 1."""
    geometry: Geometry = None
    """The picture's geometry; None until its vertices are projected."""


UNLIT, FLAT, GOURAUD, PHONG, PBR = 0, 1, 2, 3, 4
"""Shading models, as ``Surface.materials`` numbers them."""

MATERIAL_SPECULAR, MATERIAL_SHININESS, MATERIAL_MODEL = 4, 5, 6
"""Columns of ``Surface.materials`` after the base colour."""


class Alphas(NamedTuple):
    """The objects that are alpha-blended."""

    is_blended: Any
    """(O,) uint8: 1 where an object is blended with what lies behind it."""


class Maps(NamedTuple):
    """Material maps besides base colour, and their factors: see ``surface.material_maps``."""

    factors: Any
    """(O, 5) float32: normal scale, occlusion strength, emitted red, green, blue (linear)."""
    counts: Any
    """(14,) int64, objects with a texture of each kind, in the order of ``texture_filters``."""
    tangents: Any
    """(V, 2, 4) float32, model space: tangent and sign of the bitangent, for faces whose texture is
    not mirrored and for those where it is; (0, 2, 4) if no object has a normal map."""
    coordinates: Any
    """For each kind of texture: (V, 2) float32 | None -> those of ``Textures.uv``."""


class IsoLines(NamedTuple):
    """The iso-lines of the scalars of all objects: see ``surface.isolines``."""

    levels: Any
    """(N,) float64: the levels of each object, ascending."""
    ranges: Any
    """(O, 2) int64: index of an object's first level, and the number of its levels."""
    lines: Any
    """(O, 4) float32: half the width of lines, pixels; red, green, blue, linear."""


class VertexScalars(NamedTuple):
    """The scalars of all objects' vertices, and their colormaps: see ``surface.scalar_colors``."""

    values: Any
    """(V,) float64."""
    intervals: Any
    """(O, 2) float64: the value of the first entry, and the width of the interval."""
    thresholds: Any
    """(T,) float64: where entries begin, of the objects where they are not evenly spaced."""
    entries: Any
    """(O, 3) int64: first row of ``colors``, number of entries, and index of their first threshold
    or -1; no entries without a colormap."""
    colors: Any
    """(N, 4) float32, linear RGBA: the entries of each map, then the colour of NaN."""
    contours: IsoLines | None = None
    """None -> no object has iso-lines."""


class Microfacets(NamedTuple):
    """The metallic-roughness materials of all objects."""

    factors: Any
    """(O, 2) float32: metallic, roughness."""
    lobes: Any
    """(2,) float32: factors on diffuse and specular light; 1 and 1, except for outputs of one of
    them alone."""


class Layers(NamedTuple):
    """Material layers of glTF's extensions; a kind that no object in view has is None."""

    coats: Any
    """(O, 10) float32: rows from COAT on, see ``surface.sample_block``."""
    coat_scales: Any
    """(O, 1) float32: factor on x and y of the clearcoat's normal map."""
    coat_tangents: Any
    """As ``Maps.tangents``, for the normal maps of clearcoats."""
    sheens: Any
    """(O, 4) float32: red, green, blue, roughness."""
    dielectrics: Any
    """(O, 5) float32: rows from F0_RED on."""
    probe_rows: Any
    """(O, 9) float32: rows from LAYER_RED on of a white mirror, lit for microfacet materials."""
    albedo: Any
    """``lighting.sheen.ALBEDO`` as an array."""


IOR, F0, F90, ATTENUATION_COLOR, INVERSE_DISTANCE = 0, 1, 2, 3, 6
"""Columns of ``TransmissionRows.factors``: F90 is a factor on all specular reflection;
attenuation has three channels, at a distance whose inverse follows."""


class TransmissionRows(NamedTuple):
    """Transmission and volume of the objects."""

    rows: Any
    """(O, 2) float32: transmission; thickness in units of the mesh."""
    factors: Any
    """(O, 7) float32: columns from IOR on."""


class Surface(NamedTuple):
    """The objects' materials and vertex attributes."""

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
    """Normal maps, emission ... | None -> nothing."""
    alphas: Alphas | None = None
    """Alpha-blended objects | None -> all are opaque."""
    microfacets: Microfacets | None = None
    """Metallic-roughness materials | None -> none."""
    fields: VertexScalars | None = None
    """Scalars of vertices | None -> none."""
    points: Any = None
    """The points in view, and the camera's rays: `PicturePoints.read` | None -> none."""
    coded: CodedTextures | None = None
    """Textures that are read as codes | None -> none."""
    in_float32: Any = None
    """(O,) uint8: 1 where vertex colours are interpolated in float32 | None -> nowhere."""
    transmission: TransmissionRows | None = None
    """Transmission | None -> none in view."""
    layers: Layers | None = None
    """Clearcoat, sheen, custom specular | None -> none in view."""


class PyrenderObjects(NamedTuple):
    """Inputs of pyrender's shading model for each object."""

    falls_on: Any
    """(O, L) uint8: 1 where a light falls on an object."""
    faces_viewer: Any
    """(O,) uint8: 1 where normals are turned to the viewer | None -> nowhere."""
    are_squares: Any = None
    """(O,) uint8: 1 where two triangles stand for a point each | None -> nowhere."""
    gains: Any = None
    """(O, 6) float32: factors on base colours and on those of vertices | None -> all are 1."""
    maps: Any = ()
    """Of each light with a shadow map: its row, ``pack_light_view`` and the map, see
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
    """Not 0: interpolated normals are normalized; 0: used as they are."""
    pyrender: PyrenderObjects | None = None
    """Inputs of pyrender's shading model, see ``lighting.pyrender`` | None -> another one."""
