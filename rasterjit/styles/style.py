"""Define a style: a prepared scene, and the arguments to render it with."""

from __future__ import annotations

import copy
import math
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame
from rasterjit.outputs.output_table import check_outputs
from rasterjit.pipeline import srgb_encoding
from rasterjit.rendering.renderer import explain, render
from rasterjit.rendering.view_warnings import STRONG
from rasterjit.scene import validation as check
from rasterjit.scene.background import Background, BackgroundImage, read_background
from rasterjit.scene.camera import Camera
from rasterjit.scene.camera_fitting import default_camera
from rasterjit.scene.color import decoding_table
from rasterjit.scene.colormap import Colormap
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import TEXTURE_FIELDS, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import unit_rows
from rasterjit.scene.points import Points
from rasterjit.scene.quality import Quality, check_quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import Anisotropy, Texture
from rasterjit.scene.tone_map import MAX_STOPS
from rasterjit.scene.validation import image_size
from rasterjit.scene.vectors import dot
from rasterjit.scene.warning import REPEATED, silence_warnings
from rasterjit.styles.shadow_catcher import (
    Ground,
    Vector,
    cast_shadow,
    darken_background,
    darken_everywhere,
    find_ground,
    is_above,
)
from rasterjit.survey.deformation import pose_scene
from rasterjit.survey.light_culling import max_reflected_light
from rasterjit.survey.object_counts import find_base_color
from rasterjit.survey.plan import RenderPlan

EXPOSURE_SIZE = (96, 96)
"""Size of the picture that the exposure is measured in, pixels."""

BRIGHT_PERCENTILE, BRIGHT_TARGET = 0.95, 0.8
"""Percentile of the visible light, 0..1, and the linear level that exposure takes it to."""

MINUS_QUARTER_STOP, MINUS_THREE_QUARTER_STOPS = 0.8408964152537145, 0.5946035575013605
"""2 to the power of -1/4 and of -3/4."""


def choose_exposure(scene: Scene, camera: Camera | None) -> float:
    """
    Return the exposure, stops, for strong lights of a scene; 0 for others.

    Parameters
    ----------
    scene : Scene
        A scene with its own lights, without a tone map.
    camera : Camera, optional
        Default: as `rasterjit.render` has it.
    """
    if max_reflected_light(scene.lights, scene.environment) <= STRONG:
        return 0.0
    with silence_warnings(REPEATED):
        frame = render(
            scene, camera, size=EXPOSURE_SIZE, outputs=("linear",), background="transparent"
        )
    visible = frame.linear[frame.linear[:, :, 3] > 0.5]
    if not len(visible):
        return 0.0
    levels = np.sort(visible[:, :3].max(axis=1))
    level = float(levels[int(BRIGHT_PERCENTILE * (len(levels) - 1))])
    if level <= STRONG:
        return 0.0
    # Round to half a stop, without a logarithm, which may differ from machine to machine.
    mantissa, stops = math.frexp(level / BRIGHT_TARGET)
    below = (mantissa < MINUS_QUARTER_STOP) + (mantissa < MINUS_THREE_QUARTER_STOPS)
    return max(0.5 * below - stops, -MAX_STOPS)


DEPTH_COLORMAP = Colormap(np.repeat(np.arange(246, 51, -1, dtype=np.uint8)[:, None], 3, axis=1))
"""Greys of depths, the nearest first; the farthest is not black."""

UNLIT = Material(shading="unlit")

DRAWABLE_TYPES = (Mesh, Points, Lines)

SMOOTH_SHADINGS = ("phong", "gouraud", "pbr")
"""Shadings that interpolate vertex normals."""


def replace_meshes(
    scene: Scene, paint: Callable[[Node], Mesh], types: tuple[type[Mesh], ...] = (Mesh,)
) -> Scene:
    """
    Return a posed scene in which ``paint`` replaces the meshes of some types.

    Parameters
    ----------
    scene : Scene
    paint : callable
        Returns the mesh to draw for a node.
    types : tuple of type
    """
    scene = pose_scene(scene)
    painted = copy.copy(scene)
    painted.nodes = [
        node._with_mesh(paint(node)) if type(node.mesh) in types else node for node in scene.nodes
    ]
    return painted


def recolor(scene: Scene, material: Material) -> Scene:
    """Return a scene whose triangles all have one material, and no vertex or face colours."""
    meshes: dict[int, Mesh] = {}

    def paint(node: Node) -> Mesh:
        if id(node.mesh) not in meshes:
            mesh = node.mesh.without_colors()
            meshes[id(node.mesh)] = _keep_shape(node.mesh, mesh, material)
        return meshes[id(node.mesh)]

    return replace_meshes(scene, paint)


def _keep_shape(
    mesh: Mesh, changed: Mesh, material: Material, sources: NDArray[Any] | slice = slice(None)
) -> Mesh:
    """
    Give a changed mesh a material with as many sides as before, and the holes of the alpha mask.

    Film is as clear as it is, or not there: what blends gets an alpha of 0 in holes. ``sources``
    are the vertices that those of the changed mesh were.
    """
    own = mesh.material
    changed.material = replace(material, double_sided=own.double_sided)
    if own.alpha_mode != "mask":
        return changed
    texture, mode, cutoff = own.base_color_texture, material.alpha_mode, None
    red, green, blue, clearness = material.base_color_over(True)
    alpha = find_base_color(mesh)[3]
    if mode == "blend":
        cutoff = own.alpha_cutoff / alpha if alpha > 0.0 else math.inf
        alpha = clearness if cutoff <= 1.0 else 0.0
    changed.material = replace(
        changed.material, base_color=(red, green, blue, alpha),
        alpha_mode="blend" if mode == "blend" else "mask", alpha_cutoff=own.alpha_cutoff,
        base_color_texture=None if texture is None else _texture_holes(texture, cutoff),
    )  # fmt: skip
    of_vertices = None if mesh.vertex_colors is None else mesh.vertex_colors[sources]
    changed._vertex_colors = _color_holes(of_vertices, changed.vertex_colors, cutoff)
    if len(changed.faces) == len(mesh.faces):
        changed._face_colors = _color_holes(mesh.face_colors, changed.face_colors, cutoff)
    return changed


def _color_holes(
    colors: NDArray[np.float32] | None, shown: NDArray[np.float32] | None, cutoff: float | None
) -> NDArray[np.float32] | None:
    """Return colours that are shown, white if none, with the alpha of others: see `_keep_shape`."""
    if colors is None or (colors[:, 3] >= 1.0).all():
        return shown
    holes = np.ones_like(colors) if shown is None else shown.copy()
    holes[:, 3] = colors[:, 3] if cutoff is None else colors[:, 3] >= cutoff
    return check.read_only(holes)


_HOLES: weakref.WeakKeyDictionary[Texture, dict[float | None, Texture]] = (
    weakref.WeakKeyDictionary()
)
"""Cache: what `_texture_holes` returns, by texture and cutoff."""


def _texture_holes(texture: Texture, cutoff: float | None = None) -> Texture:
    """Return a white texture with the alpha of another one; given a cutoff, with 0 or 1 instead."""
    known = _HOLES.setdefault(texture, {})
    if cutoff not in known:
        known[cutoff] = _make_texture_holes(texture, cutoff)
    return known[cutoff]


def _make_texture_holes(texture: Texture, cutoff: float | None) -> Texture:
    """Return the texture of `_texture_holes`, which keeps it."""
    image = texture.image.copy()
    image[..., :3] = 1.0
    if cutoff is None:
        return replace(texture, image=image)
    image[..., 3] = image[..., 3] >= cutoff
    return replace(texture, image=image, filter="nearest", anisotropy=1)


def sharpen_textures(scene: Scene, anisotropy: Anisotropy) -> Scene:
    """
    Return a scene whose trilinear textures are anisotropic; itself if it has none to change.

    Textures of other filters, and anisotropic ones, stay as they are.
    """
    meshes: dict[int, Mesh] = {}
    textures: dict[Texture, Texture] = {}
    for node in scene.nodes:
        mesh = node.mesh
        if type(mesh) is not Mesh or id(mesh) in meshes:
            continue
        changes: dict[str, Any] = {}
        for name in TEXTURE_FIELDS:
            texture = getattr(mesh.material, name)
            if texture is None or texture.filter != "trilinear" or texture.anisotropy > 1:
                continue
            if texture not in textures:
                textures[texture] = texture.with_filter("trilinear", anisotropy)
            changes[name] = textures[texture]
        if changes:
            mesh_copy = meshes[id(mesh)] = copy.copy(mesh)
            mesh_copy.material = replace(mesh.material, **changes)
    if not meshes:
        return scene
    changed = copy.copy(scene)
    changed.nodes = [
        node._with_mesh(meshes[id(node.mesh)]) if id(node.mesh) in meshes else node
        for node in scene.nodes
    ]
    return changed


def color_by_depth(scene: Scene, camera: Camera) -> Scene:
    """Return a scene whose objects have greys by depth along the viewing axis."""
    scene, row = pose_scene(scene), camera.view_matrix()[2].tolist()
    depths, low, high = {}, np.inf, -np.inf
    for node in scene.nodes:
        if type(node.mesh) not in DRAWABLE_TYPES:
            continue
        matrix, positions = node.world_matrix, node.mesh.vertices
        x, y, z, w = (dot(row, column) for column in matrix[:3].T.tolist())
        w += row[3]
        # Vertices of no face may be infinite.
        with np.errstate(over="ignore", invalid="ignore"):
            depth = -(((positions[:, 0] * x + positions[:, 1] * y) + positions[:, 2] * z) + w)
        depths[id(node)] = depth
        in_front = depth[(depth > 0.0) & node.mesh.used_vertices()]
        if len(in_front):
            low, high = min(low, float(in_front.min())), max(high, float(in_front.max()))
    if not low < high:
        low, high = 0.0, 1.0

    def paint(node: Node) -> Mesh:
        # Normalized, as scalars are float32: too few digits, or too small a range, for depths.
        shares = (np.clip(depths[id(node)], low, high) - low) / (high - low)
        mesh = node.mesh.with_scalars(shares, DEPTH_COLORMAP, range=(0.0, 1.0))
        return _keep_shape(node.mesh, mesh, UNLIT)

    return replace_meshes(scene, paint, DRAWABLE_TYPES)


def color_by_normal(scene: Scene) -> Scene:
    """Return a scene whose triangles have colours by world-space normal: red x, green y, blue z."""

    def paint(node: Node) -> Mesh:
        mesh = node.mesh
        matrix = node.world_matrix[:3, :3]
        positions, faces = mesh.vertices, mesh.faces
        sources: NDArray[Any] | slice = slice(None)
        if mesh.normals is not None or mesh.material.shading in SMOOTH_SHADINGS:
            normals = mesh.vertex_normals().astype(np.float64)
        else:
            # Give each face its own vertices.
            sources, faces = faces.ravel(), np.arange(faces.size).reshape(-1, 3)
            positions = positions[sources]
            a, b, c = (positions[k::3] for k in range(3))
            normals = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        # The cofactors transform normals as the matrix transforms surfaces.
        cofactors = np.stack([np.cross(matrix[(k + 1) % 3], matrix[(k + 2) % 3]) for k in range(3)])
        x, y, z = normals.T
        world = np.stack([(x * r[0] + y * r[1]) + z * r[2] for r in cofactors], axis=1)
        if dot(matrix[0].tolist(), cofactors[0].tolist()) < 0.0:
            world = -world
        colors = np.clip(np.floor(unit_rows(world) * 127.5 + 128.0), 0.0, 255.0).astype(np.uint8)
        uv, uv1 = (None if one is None else one[sources] for one in mesh.uv_sets)
        colored = Mesh(positions, faces, colors=colors, uv=uv, uv1=uv1, on_invalid="drop")
        return _keep_shape(mesh, colored, UNLIT, sources)

    return replace_meshes(scene, paint)


SIZE = (1280, 720)
"""Default size of pictures, pixels."""

SAMPLES_ROW = "anti-aliasing"
"""Row of ``explain`` on samples."""

QUALITY_ROWS = {SAMPLES_ROW: "samples", "textures": "texture_filter", "wireframe": "lines"}
"""Rows of ``explain`` that depend on a setting of the quality."""

BACKGROUND_ROW = "background image"
"""Row of ``explain`` on the background and the shadow on the ground."""


def _make_bayer_pattern(levels: int) -> NDArray[np.int64]:
    """Return Bayer's dither pattern of 2**levels rows: all numbers from 0 on, spread evenly."""
    pattern = np.zeros((1, 1), np.int64)
    for _ in range(levels):
        pattern = 4 * pattern
        pattern = np.block([[pattern, pattern + 2], [pattern + 3, pattern + 1]])
    return pattern


OPAQUE, GREY_STEP = np.uint32(0xFF000000), np.uint32(0x010101)
"""Pixels as uint32: opaque black, and the difference of two neighbouring greys."""

BAYER_PATTERN = _make_bayer_pattern(3)
"""(8, 8): the order in which pixels of a block take the next grey."""


class Gradient(NamedTuple):
    """A background of greys from top to bottom, dithered against bands."""

    top: int
    """Code of the first row, 0..255."""
    bottom: int
    """Code of the last row."""

    def picture(self, size: tuple[int, int]) -> BackgroundImage:
        """Return the gradient as a picture of (width, height) pixels."""
        width, height = size
        row, last = np.arange(height), max(height - 1, 1)
        # Dither exactly, in whole numbers: each code is in units of 1 / (2 * size * last).
        side, unit = len(BAYER_PATTERN), 2 * BAYER_PATTERN.size
        exact = self.top * (last - row) + self.bottom * row
        thresholds = last * (2 * BAYER_PATTERN[row % side] + 1)
        codes = (unit * exact[:, None] + thresholds) // (unit * last)
        pixels = OPAQUE + GREY_STEP * codes.astype(np.uint32)
        image = np.tile(pixels, (1, -(-width // side)))[:, :width]
        return BackgroundImage(np.ascontiguousarray(image).view(np.uint8).reshape(height, width, 4))


class GroundLight(NamedTuple):
    """The light on the invisible ground, which the shadow removes."""

    key: Vector | None
    """(3,): direction towards the key light, world space, if there is one."""
    shares: tuple[float, float]
    """Shares of the light of the key light and the sky; their sum is 0..1."""


@dataclass(frozen=True, eq=False)
class Style:
    """
    A scene with the arguments to render it; ``dataclasses.replace`` changes parts of it.

    Attributes
    ----------
    name : str
    scene : Scene
        A copy of the scene that the style was made of, with the same meshes unless the style paints
        them or sharpens their textures. Make the style anew after a change, as the ground and its
        shadow are computed once.
    camera : Camera or None
        None: the scene's own, or one that fits the scene.
    quality : Quality
    background : Background, Gradient or None
        As `rasterjit.render` takes it, or greys from top to bottom.
    ground : GroundLight or None
        Light on the plane under the scene, on which it casts a shadow; None for no shadow. The
        shadow is only part of the background.
    adds : mapping of str
        What the style adds, in words, by the row of ``explain``.
    """

    name: str
    scene: Scene
    camera: Camera | None = None
    quality: Quality = field(default_factory=Quality.standard)
    background: Background | Gradient = None
    ground: GroundLight | None = None
    adds: Mapping[str, str] = field(default_factory=dict)

    def render(
        self, camera: Camera | None = None, *, size: tuple[int, int] = SIZE, **options: Any
    ) -> Frame:
        """
        Render a frame in this style.

        Parameters
        ----------
        camera : Camera, optional
            Default: the style's. The lamp of `studio` always stands beside the style's camera.
        size : (int, int)
            Width and height, pixels.
        **options
            Other arguments of `rasterjit.render`; a ``quality`` or ``background`` replaces the
            style's.

        Returns
        -------
        Frame

        Raises
        ------
        ValueError
            As `rasterjit.render` does.
        """
        options["camera"] = camera
        arguments, has_shadow = self._render_options(size, options)
        frame = render(self.scene, size=size, **arguments)
        frame.plan = self._explain(frame.plan, options, has_shadow)
        return frame

    def explain(
        self, camera: Camera | None = None, *, size: tuple[int, int] = SIZE, **options: Any
    ) -> RenderPlan:
        """
        Return the plan of `render`, with the style as the reason of what it adds.

        Takes what `rasterjit.explain` takes, but for the scene. The plan prints as a table. It
        counts on a shadow wherever the ground around the scene is in view.
        """
        options["camera"] = camera
        arguments, has_shadow = self._render_options(size, options, casts_shadow=False)
        plan = explain(self.scene, size=size, **arguments)
        return self._explain(plan, options, has_shadow)

    def options(self, size: tuple[int, int], **options: Any) -> dict[str, Any]:
        """
        Return the keyword arguments of `rasterjit.render` for a frame of a size.

        ``rj.render(style.scene, size=size, **style.options(size))`` draws what `render` draws.

        Parameters
        ----------
        size : (int, int)
            Width and height, pixels.
        **options
            They replace the style's, except those that are None.

        Returns
        -------
        dict
            With ``camera``, ``background`` and, unless the options choose another way to find it,
            ``quality``.
        """
        return self._render_options(size, options)[0]

    def _render_options(
        self, size: tuple[int, int], options: Mapping[str, Any], casts_shadow: bool = True
    ) -> tuple[dict[str, Any], bool]:
        """
        Return the arguments of a render, and whether a shadow is in the background.

        Without ``casts_shadow``, all of the ground in view is dark instead.
        """
        arguments = {name: value for name, value in options.items() if value is not None}
        camera, has_shadow = arguments.setdefault("camera", self.camera), False
        if not {"max_error", "time_budget"} & set(arguments):
            arguments.setdefault("quality", self.quality)
        if {"color", "linear"} & set(check_outputs(arguments.get("outputs", ("color",)))):
            size = image_size("size", size)
            background, ground = self._choose_background(size, arguments, camera)
            arguments["background"] = background
            if ground is not None:
                camera = camera or self.scene.camera or default_camera(self.scene, size)
                arguments["camera"], codes = camera, _encode_background(background, size)
                image = self._shade_background(ground, camera, codes, arguments, casts_shadow)
                if image is not None:
                    arguments["background"], has_shadow = BackgroundImage(image), True
        return arguments, has_shadow

    def _explain(
        self, plan: RenderPlan, options: Mapping[str, Any], has_shadow: bool
    ) -> RenderPlan:
        """Return a plan that names the style as the reason of what it adds itself."""
        reasons = dict(self.with_quality(plan.quality).adds)
        if SAMPLES_ROW in reasons:
            # A copy of the style may have another quality.
            samples = self.quality.samples
            reasons[SAMPLES_ROW] = "areas" if samples == "area" else f"{samples} samples"
        parts = [] if options.get("background") is not None else [reasons.get(BACKGROUND_ROW, "")]
        parts += ["the shadow on the ground"] if has_shadow else []
        reasons[BACKGROUND_ROW] = ", with ".join(filter(None, parts))
        texts = {row: f"style {self.name}: {text}" for row, text in reasons.items() if text}
        return plan.for_picture(added=texts) if texts else plan

    def with_quality(self, quality: Quality) -> Style:
        """
        Return the style with another quality, and the reasons that still hold.

        Parameters
        ----------
        quality : Quality
        """
        quality = check_quality(quality)
        adds = {
            row: text
            for row, text in self.adds.items()
            if row not in QUALITY_ROWS
            or getattr(quality, QUALITY_ROWS[row]) == getattr(self.quality, QUALITY_ROWS[row])
        }
        return replace(self, quality=quality, adds=adds)

    def _choose_background(
        self, size: tuple[int, int], arguments: Mapping[str, Any], camera: Camera | None
    ) -> tuple[Any, Ground | None]:
        """Return the background, and the ground if its shadow may be visible."""
        value = arguments.get("background", self.background)
        if value is None:
            return None, None
        is_gradient = isinstance(value, Gradient)
        background = value.picture(size) if isinstance(value, Gradient) else read_background(value)
        # Photographs and transparent backgrounds have no ground.
        is_opaque = is_gradient or (
            not isinstance(background, BackgroundImage) and bool(background[3] >= 1.0)
        )
        if self.ground is None or not is_opaque or arguments.get("lens") is not None:
            return background, None
        return background, self._find_ground()

    def _find_ground(self) -> Ground | None:
        """Return the ground without its shadow, computed once; None if there is none."""
        if "_placed" not in self.__dict__:
            ground = None if self.ground is None else find_ground(self.scene, self.ground.key)
            object.__setattr__(self, "_placed", ground)
        return self.__dict__["_placed"]

    def _shade_background(
        self, ground: Ground, camera: Camera, background: tuple[Any, Any],
        options: Mapping[str, Any], casts_shadow: bool,
    ) -> NDArray[np.uint8] | None:  # fmt: skip
        """Return the background with the shadow, (H, W, 4); None if there is none in view."""
        palette, codes = background
        if not is_above(ground, camera, codes.shape[::-1]):
            return None
        threads = options.get("threads")
        ground = self._cast_shadow(ground, threads) if casts_shadow else darken_everywhere(ground)
        image = darken_background(ground, camera, palette, codes)
        return None if image is None else image.view(np.uint8).reshape(*codes.shape, 4)

    def _cast_shadow(self, ground: Ground, threads: int | None) -> Ground:
        """Return the ground with the scene's shadow, computed once."""
        if "_shaded" not in self.__dict__:
            shares = (0.0, 0.0) if self.ground is None else self.ground.shares
            object.__setattr__(self, "_shaded", cast_shadow(ground, self.scene, shares, threads))
        return self.__dict__["_shaded"]


def _encode_background(
    background: NDArray[np.float32] | BackgroundImage, size: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return linear colours by red code, (256, 4), and the background as codes, (H, W) uint32."""
    palette = np.ones((256, 4), np.float32)
    if isinstance(background, BackgroundImage):
        palette[:, :3] = decoding_table()[:, None]
        return palette, background.image.view(np.uint32)[..., 0]
    palette[:, :3] = background[:3]
    code = np.empty((1, 1), np.uint32)
    srgb_encoding.encode_rows(palette[None, :1], srgb_encoding.make_encoding_table(), code)
    return palette, np.full(size[::-1], code[0, 0])


def copy_with_changes(scene: Scene, **changes: Any) -> Scene:
    """Return a copy of a scene, its lists copied too, with other lights or effects."""
    changed = copy.copy(scene)
    for name in ("nodes", "lights"):
        values = getattr(scene, name)
        # Other values are reported where scenes are checked.
        if isinstance(values, list | tuple):
            setattr(changed, name, list(values))
    for name, value in changes.items():
        setattr(changed, name, value)
    return changed
