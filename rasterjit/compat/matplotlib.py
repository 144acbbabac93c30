"""
Scenes in matplotlib's axes.

In flat axes a picture of the scene fills the axes, or shows a plane of it whose coordinates are the
axes'. In 3-D axes the scene is seen with the axes' own projection, at its place in their
coordinates, so that it fits their lines and points; those that are handed to `SceneArtist.hide` are
hidden where a face is nearer. A colour bar, the cursor and pick events know the scene's scalars.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.io.meshes import as_scene
from rasterjit.outputs.colorbar import EXTENDS, find_scale
from rasterjit.outputs.frame import PICK_OUTPUTS, Frame, PickedPixel
from rasterjit.outputs.output_table import OutputName
from rasterjit.rendering.planning import choose_camera
from rasterjit.rendering.renderer import Renderer, explain
from rasterjit.scene import transforms
from rasterjit.scene import validation as check
from rasterjit.scene.camera import Camera, MatrixCamera
from rasterjit.scene.camera_fitting import BoundingSphere, fit_camera
from rasterjit.scene.color import linear_color, linear_to_srgb
from rasterjit.scene.norm import ForeignNorm
from rasterjit.scene.quality import Quality
from rasterjit.scene.scalar_field import ColorScale
from rasterjit.scene.scene import Scene

try:
    from matplotlib import artist
    from matplotlib.axes import Axes
    from matplotlib.backend_bases import MouseEvent, RendererBase
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import Collection, PathCollection
    from matplotlib.colorbar import Colorbar
    from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize, SymLogNorm
    from matplotlib.lines import Line2D
    from matplotlib.transforms import Bbox, IdentityTransform, Transform
    from mpl_toolkits.mplot3d import Axes3D
    from mpl_toolkits.mplot3d.art3d import Line3D
except ImportError as error:
    raise ImportError(
        f'pictures in axes need matplotlib: pip install "rasterjit[mpl]" ({error})'
    ) from error

DEPTH_MARGIN = 0.01
"""Margin between the scene and the near and far plane, as a share of its depth."""

MIN_NEAR = 1e-4
"""Least near plane, as a share of the distance of the farthest point."""

DEPTH_BIAS = 2e-3
"""Share of the scene's size by which a line may lie behind a face and still be seen: one that lies
on it is."""

SAMPLE_STEP = 0.5
"""Distance between the samples of a line that are compared with the depth, pixels."""

PIXEL_TOLERANCE = 1e-6
"""Tolerance of sides that ought to be whole pixels."""

Plane: TypeAlias = Literal["xy", "xz", "yz", "yx", "zx", "zy"]
PLANES: tuple[Plane, ...] = get_args(Plane)
"""Axes of the scene that go to the right and up."""

MAX_SAMPLES = 64
"""Most samples of a segment, in sides of the picture: it may reach far beside."""


class SceneArtist(artist.Artist):
    """
    Draws a scene into axes, rendered anew for each size in pixels and view.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or mpl_toolkits.mplot3d.Axes3D
        It adds itself to them. Limits of 3-D axes that were not set are widened to the scene and to
        what else is in them, whatever comes first.
    what : Scene, Mesh, Points, Lines, trimesh.Trimesh or trimesh.Scene
        Not to be changed while it is shown.
    camera : Camera, optional
        For flat axes. Default: the scene's own, else one that fits the scene.
    quality : Quality, optional
        Default ``Quality.standard()`` with 8 samples.
    background : color, optional
        Default: ``"transparent"``: the axes show.
    up : (3,) array_like, world space, optional
        Which way of the scene is up. In 3-D axes it is turned so that this lies along their z,
        by the smallest angle: with ``(0, 1, 0)`` the scene's x, y and z are the axes' x, z and -y.
        Default: the scene's coordinates are those of the axes. In flat axes it is for a camera that
        fits the scene, by default y.
    plane : {"xy", "xz", "yz", "yx", "zx", "zy"}, optional
        In flat axes: which of the scene's coordinates are those of the axes, to the right and up.
        It is seen without perspective from where both go so; limits are widened to it, units are
        as long in both directions, and other limits show another part.
    zorder : float
        Below lines by default, above the panes and grids of 3-D axes.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.

    Notes
    -----
    Matplotlib draws one artist over the other; only what is handed to `hide` knows depth.
    """

    def __init__(
        self,
        axes: Axes,
        what: Any,
        camera: Camera | None = None,
        *,
        quality: Quality | None = None,
        background: Any = "transparent",
        up: ArrayLike | None = None,
        plane: Plane | None = None,
        zorder: float = 1.0,
    ) -> None:
        super().__init__()
        if not isinstance(axes, Axes):
            raise ValueError(f"axes must be matplotlib's Axes, got {type(axes).__name__}")
        self.scene: Scene = as_scene(what)
        self._is_spatial = isinstance(axes, Axes3D)
        if self._is_spatial and camera is not None:
            raise ValueError("camera must be None in 3-D axes, which have their own view")
        if not self._is_spatial:
            camera = (
                self.scene.camera if camera is None else choose_camera(self.scene, camera, (1, 1))
            )
        if plane is not None:
            check.one_of("plane", plane, PLANES)
            if self._is_spatial or camera is not None or up is not None:
                raise ValueError(
                    f"plane must be None in 3-D axes and where camera or up is given, got {plane!r}"
                )
        self._plane = None if plane is None else _make_plane_projection(plane)
        linear_color("background", background)
        self._up = None if up is None else transforms.unit_vector("up", up)
        self._rotation = _make_rotation_to_z(self._up)
        self._camera, self._background = camera, background
        self._quality = Quality(samples=8) if quality is None else quality
        # What is wrong is said at once.
        explain(self.scene, camera, self._quality, size=(1, 1), background=background)
        self._ball = BoundingSphere.around(self.scene)
        self._frames: dict[tuple[OutputName, ...], tuple[Any, Frame]] = {}
        self._original_draws: dict[Line3D | PathCollection, Callable[[RendererBase], None]] = {}
        self.set_zorder(zorder)
        had_data = axes.has_data()
        axes.add_artist(self)
        self._data = _DataMarker()
        axes.add_artist(self._data)
        if self._is_spatial:
            axes.auto_scale_xyz(*(self._scene_corners() @ self._rotation[:3, :3].T).T, had_data)
        elif self._plane is not None:
            axes.set_aspect("equal")
            axes.update_datalim(self._scene_corners() @ self._plane[:2, :3].T)
            axes.autoscale_view()

    @property
    def mappable(self) -> ScalarMappable:
        """The colours and the norm of the scene's scalars, as colour bars take them."""
        scale = find_scale([_scale_of(node) for node in self.scene.nodes], None)
        shown = ListedColormap(scale.colormap.codes / 255.0, scale.colormap.name or "scene")
        under, over, bad = (
            (*linear_to_srgb(color[:3]).tolist(), float(color[3]))
            for color in (
                scale.colormap.under, scale.colormap.over,
                np.zeros(4) if scale.nan_color is None else scale.nan_color,
            )
        )  # fmt: skip
        return ScalarMappable(
            _make_norm(scale), shown.with_extremes(under=under, over=over, bad=bad)
        )

    def colorbar(self, label: str = "", **options: Any) -> Colorbar:
        """
        Add Matplotlib's colour bar of the scene's scalars to the figure.

        Parameters
        ----------
        label : str
            Stands beside it.
        **options
            As ``Figure.colorbar`` takes them; ``ax`` is by default these axes, and ``extend`` says
            at which ends values lie beyond the range. Contours are lines across it.

        Raises
        ------
        ValueError
            If no object has scalars, or they have several colour maps, norms or ranges.
        """
        scale = find_scale([_scale_of(node) for node in self.scene.nodes], None)
        extend = EXTENDS[scale.exceeds[0] + 2 * scale.exceeds[1]]
        bar = self.figure.colorbar(
            self.mappable, **{"ax": self.axes, "label": label, "extend": extend} | options
        )
        if scale.colormap.categories:
            low, high = scale.norm.range
            names = {n: one for n, one in enumerate(scale.colormap.categories) if low <= n <= high}
            bar.set_ticks([*names], labels=[*names.values()])
        if scale.lines:
            levels, colors = zip(*scale.lines, strict=True)
            bar.add_lines(levels, [tuple(linear_to_srgb(one[:3])) for one in colors], 0.8)
        return bar

    def pick_at(self, x: float, y: float) -> PickedPixel | None:
        """
        Return what the scene shows at a place of the canvas, as axes are laid out now.

        Parameters
        ----------
        x, y : float
            Pixels of the canvas from the left and the bottom, as events of the mouse have them.

        Returns
        -------
        PickedPixel or None
            As `Frame.pick` returns it, with the scalar if there are scalars; its position is in the
            scene's coordinates. None where nothing is.
        """
        camera, size, area = self._find_view(1.0)
        column = (x - area.x0) * size[0] / area.width
        row = (area.y1 - y) * size[1] / area.height
        if not (0.0 <= column < size[0] and 0.0 <= row < size[1]):
            return None
        has_scalars = any(node.mesh.field is not None for node in self.scene.nodes)
        scalars: tuple[OutputName, ...] = ("scalar",) if has_scalars else ()
        return self._render(camera, size, (*PICK_OUTPUTS, *scalars)).pick(column, row)

    def contains(self, mouseevent: MouseEvent) -> tuple[bool, dict[str, Any]]:
        """Tell whether the mouse is on the scene; ``picked`` is what is there: see `pick_at`."""
        if mouseevent.inaxes is not self.axes or not self.get_visible():
            return False, {}
        picked = self.pick_at(mouseevent.x, mouseevent.y)
        return (False, {}) if picked is None else (True, {"picked": picked})

    def get_cursor_data(self, event: MouseEvent) -> PickedPixel | None:
        """Return what is under the mouse: see `pick_at`."""
        return self.pick_at(event.x, event.y)

    def format_cursor_data(self, data: PickedPixel) -> str:
        """Return where the surface under the mouse is, and its scalar."""
        text = ", ".join(f"{coordinate:.4g}" for coordinate in data.position.tolist())
        return f"({text})" + ("" if data.scalar is None else f" {data.scalar:.4g}")

    def _scene_corners(self) -> NDArray[np.float64]:
        """Return the corners of the scene's bounding box, (8, 3)."""
        return np.array(list(itertools.product(*np.transpose(self.scene.bounds()))))

    def hide(self, *things: Line3D | PathCollection) -> None:
        """
        Hide lines and points of the same 3-D axes where a face of the scene is nearer.

        Parameters
        ----------
        *things : Line3D or Path3DCollection
            What ``Axes3D.plot`` and ``Axes3D.scatter`` return. From now on they are drawn with the
            scene. Of a line, each visible piece has dashes of its own; of its markers and of
            points, those are seen whose middle is.

        Raises
        ------
        ValueError
            If the axes are flat, or one is neither a line nor points of them.
        """
        if not self._is_spatial:
            raise ValueError("things can be hidden in 3-D axes only")
        for thing in things:
            is_point = isinstance(thing, PathCollection) and hasattr(thing, "_offsets3d")
            if not (isinstance(thing, Line3D) or is_point) or thing.axes is not self.axes:
                raise ValueError(
                    "things must be lines or points of the same 3-D axes, got "
                    f"{type(thing).__name__}"
                )
        for thing in things:
            if thing not in self._original_draws:
                self._original_draws[thing] = thing.draw
                # The axes do not draw it; legends still know it.
                thing.draw = _draw_nothing
        self.stale = True

    def remove(self) -> None:
        """Remove it from the axes; hidden things draw themselves again."""
        super().remove()
        self._data.remove()
        for thing, draw in self._original_draws.items():
            thing.draw = draw
        self._original_draws.clear()

    def draw(self, renderer: RendererBase) -> None:
        """Draw the scene and the things it hides; if it is invisible, those alone, unhidden."""
        if not self.get_visible():
            for _, draw in self._list_hidden():
                draw(renderer)
            return
        # Vector formats count in 1/72 inch; their pictures have the resolution asked for.
        camera, size, area = self._find_view(renderer.get_image_magnification())
        frame = self._render(camera, size, ("color", "depth"))
        context = renderer.new_gc()
        self._set_gc_clip(context)
        context.set_alpha(self.get_alpha())
        renderer.draw_image(context, area.x0, area.y0, frame.color[::-1])
        context.restore()
        view = None
        if self._original_draws:
            view = _Projection(camera, self._rotation, frame, area, DEPTH_BIAS * self._ball.radius)
        for thing, draw in self._list_hidden():
            if isinstance(thing, Line3D):
                self._draw_line(renderer, thing, view)
            else:
                _draw_points(renderer, thing, draw, view)
        self.stale = False

    def _find_view(self, scale: float) -> tuple[Camera | None, tuple[int, int], Bbox]:
        """Return the camera, the size in pixels and the place on the canvas of the picture."""
        box = self.axes.get_window_extent()
        left, bottom = (math.floor(side * scale + PIXEL_TOLERANCE) for side in (box.x0, box.y0))
        right, top = (math.ceil(side * scale - PIXEL_TOLERANCE) for side in (box.x1, box.y1))
        size = max(right - left, 1), max(top - bottom, 1)
        area = Bbox.from_bounds(left / scale, bottom / scale, size[0] / scale, size[1] / scale)
        is_seen_by_axes = self._is_spatial or self._plane is not None
        camera = self._make_axes_camera(area) if is_seen_by_axes else self._make_flat_camera(size)
        return camera, size, area

    def _list_hidden(
        self,
    ) -> Iterator[tuple[Line3D | PathCollection, Callable[[RendererBase], None]]]:
        """Yield the visible things that are drawn with the scene, and their draw functions."""
        for thing, draw in self._original_draws.items():
            if thing.get_visible() and thing.axes is self.axes:
                yield thing, draw

    def _render(
        self, camera: Camera | None, size: tuple[int, int], outputs: tuple[OutputName, ...]
    ) -> Frame:
        """Render outputs of a view; reuse the last frame of them if nothing changed."""
        is_matrix = isinstance(camera, MatrixCamera)
        view = (camera.clip_from_view @ camera.view_from_world).tobytes() if is_matrix else camera
        key = size, view
        held = self._frames.get(outputs)
        if held is None or held[0] != key:
            with Renderer(size, quality=self._quality) as renderer:
                held = (
                    key,
                    renderer.render(
                        self.scene, camera, outputs=outputs, background=self._background
                    ),
                )
            self._frames[outputs] = held
        return held[1]

    def _make_flat_camera(self, size: tuple[int, int]) -> Camera | None:
        """Return the camera of a picture in flat axes; None for the one that rendering chooses."""
        if self._camera is not None or self._up is None:
            return self._camera
        return fit_camera(self._ball, up=self._up, aspect=size[0] / size[1])

    def _make_axes_camera(self, area: Bbox) -> MatrixCamera:
        """Return the camera that maps the world onto an area of the canvas as the axes do."""
        # Matplotlib's matrix leads to a plane that the data transform takes to the canvas.
        projection = self._plane
        if projection is None:
            projection = np.asarray(self.axes.get_proj(), dtype=np.float64) @ self._rotation
        corners = self.axes.transData.transform([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
        ndc = 2.0 * (corners - (area.x0, area.y0)) / (area.width, area.height) - 1.0
        clip = np.zeros((4, 4))
        clip[:2] = (
            np.outer(ndc[1] - ndc[0], projection[0])
            + np.outer(ndc[2] - ndc[0], projection[1])
            + np.outer(ndc[0], projection[3])
        )
        clip[3] = projection[3]
        clip[2] = self._make_depth_row(projection)
        view = _make_view_matrix(clip, self._ball.center, self._rotation[2, :3])
        return MatrixCamera(view, clip @ transforms.inverse(view))

    def _make_depth_row(self, projection: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the row of clip z: from -1 before everything to 1 behind it."""
        is_parallel = not projection[3, :3].any()
        # What grows with the distance: w of a perspective, z of a parallel projection.
        row = projection[2] / projection[3, 3] if is_parallel else projection[3]
        middle = float(np.dot(row[:3], self._ball.center) + row[3])
        reach = float(np.linalg.norm(row[:3])) * self._ball.radius * (1.0 + DEPTH_MARGIN)
        near, far = middle - reach, middle + reach
        if is_parallel:
            scaled = (2.0 * row - np.array([0.0, 0.0, 0.0, near + far])) / (far - near)
            return scaled * projection[3, 3]
        near = max(near, MIN_NEAR * far)
        constant = np.array([0.0, 0.0, 0.0, 2.0 * near * far])
        return ((far + near) * row - constant) / (far - near)

    def _draw_line(self, renderer: RendererBase, line: Line3D, view: _Projection) -> None:
        """Draw the visible pieces and markers of a line."""
        points = np.stack(np.broadcast_arrays(*line.get_data_3d()), axis=-1).astype(np.float64)
        is_visible = view.is_visible(points)
        marks = view.project(points)[is_visible]
        for positions, hidden in ((view.cut_to_visible(points), "marker"), (marks, "linestyle")):
            piece = Line2D(*positions.T)
            piece.update_from(line)
            piece.set(transform=IdentityTransform(), figure=self.figure, **{hidden: "None"})
            piece.set(antialiased=line.get_antialiased(), clip_box=self.axes.bbox)
            piece.draw(renderer)


class _DataMarker(Collection):
    """
    An invisible artist by which axes know that they have data.

    They take limits from others' data alone where they believe that they have none yet.
    """

    def __init__(self) -> None:
        super().__init__()
        self.set(visible=False, in_layout=False)

    def get_datalim(self, transData: Transform) -> Bbox:
        """Return empty limits: those of the scene were given to the axes."""
        return Bbox.null()


class _Projection(NamedTuple):
    """The projection of points of the axes to a picture; ``rotation`` leads to them."""

    camera: MatrixCamera
    rotation: NDArray[np.float64]
    frame: Frame
    area: Bbox
    bias: float

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points, (V, 3), to the canvas, (V, 2), its units; NaN behind the eye."""
        clip = self._to_clip_space(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            ndc = np.where(clip[:, 3:] > 0.0, clip[:, :2] / clip[:, 3:], np.nan)
        return self.area.min + 0.5 * (ndc + 1.0) * (self.area.width, self.area.height)

    def is_visible(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the mask of points, (V, 3), that no face hides, in the picture, (V,)."""
        height, width = self.frame.depth.shape
        share = (self.project(points) - self.area.min) / (self.area.width, self.area.height)
        with np.errstate(invalid="ignore"):
            columns, rows = np.floor(share[:, 0] * width), np.floor((1.0 - share[:, 1]) * height)
            inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        visible = np.zeros(len(points), dtype=bool)
        surfaces = self.frame.depth[rows[inside].astype(int), columns[inside].astype(int)]
        visible[inside] = self._compute_depths(points[inside]) <= surfaces + self.bias
        return visible

    def cut_to_visible(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the visible pieces of a polyline on the canvas, (V, 2), with NaN between them."""
        if len(points) < 2:
            return np.empty((0, 2))
        positions = self.project(points)
        pixels = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        pixels *= self.frame.depth.shape[1] / self.area.width
        limit = MAX_SAMPLES * max(self.frame.depth.shape)
        counts = np.clip(np.nan_to_num(pixels / SAMPLE_STEP, nan=1.0), 1.0, limit).astype(int)
        # Even on the canvas is not even in space; so near each other that makes no difference.
        owners = np.repeat(np.arange(len(counts)), counts)
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        share = (np.arange(len(owners)) - first[owners]) / counts[owners]
        between = points[owners] + share[:, None] * np.diff(points, axis=0)[owners]
        samples = np.concatenate([between, points[-1:]])
        result = self.project(samples)
        result[~self.is_visible(samples)] = np.nan
        return result

    def _to_clip_space(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform points to clip space, (V, 4)."""
        world_from_axes = self.rotation.T
        matrix = self.camera.clip_from_view @ self.camera.view_from_world @ world_from_axes
        return points @ matrix[:, :3].T + matrix[:, 3]

    def _compute_depths(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the depths of points as `Frame.depth` counts them."""
        c0, c1, c2 = self.camera.depth_coefficients()
        clip = self._to_clip_space(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            stored = (c0 + c1 * clip[:, 2] + c2 * clip[:, 3]) / clip[:, 3]
        return self.camera.view_depth(stored)


def _scale_of(node: Any) -> ColorScale | None:
    """Return the map of a node's scalars to colours, or None."""
    return None if node.mesh.field is None else node.mesh.field.scale


def _make_norm(scale: ColorScale) -> Normalize:
    """Return Matplotlib's norm that spreads values as a scale does."""
    norm, (low, high) = scale.norm, scale.norm.range
    if isinstance(norm, ForeignNorm):
        return copy.deepcopy(norm.original)
    if scale.colormap.categories and low < high:
        count = len(scale.colormap)
        return BoundaryNorm(np.linspace(low, high, count + 1), count)
    if norm.name == "symlog":
        return SymLogNorm(norm.width, vmin=low, vmax=high)
    return (LogNorm if norm.name == "log" else Normalize)(low, high)


def _make_plane_projection(plane: Plane) -> NDArray[np.float64]:
    """Return the (4, 4) matrix to the axes of a plane, with the distance from the viewer as z."""
    right, up = (np.eye(3)["xyz".index(letter)] for letter in plane)
    result = np.eye(4)
    result[:3, :3] = right, up, -np.cross(right, up)
    return result


def _make_rotation_to_z(up: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return the smallest rotation from a direction to z; the identity for None."""
    if up is None:
        return np.eye(4)
    axis = np.cross(up, (0.0, 0.0, 1.0))
    if not axis.any():
        axis = np.array([1.0, 0.0, 0.0])
    return transforms.rotate(axis, math.degrees(math.acos(max(-1.0, min(1.0, up[2])))))


def _make_view_matrix(
    clip_from_world: NDArray[np.float64], center: ArrayLike, up: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a ``view_from_world`` for a clip matrix: it tells where a headlight is."""
    rows = clip_from_world
    if rows[3, :3].any():
        eye = MatrixCamera(np.eye(4), rows).eye_position()
        forward = np.asarray(center) - eye
    else:
        eye = np.asarray(center, dtype=np.float64)
        forward = np.cross(rows[0, :3], rows[1, :3])
        forward *= np.sign(forward @ rows[2, :3])
    is_upright = not transforms.are_parallel(forward, up)
    return transforms.look_at(eye, eye + forward, up if is_upright else rows[1, :3])


def _draw_points(
    renderer: RendererBase,
    points: PathCollection,
    draw: Callable[[RendererBase], None],
    view: _Projection,
) -> None:
    """Draw the visible points of a collection."""
    offsets = points._offsets3d
    positions = np.stack([np.ma.filled(np.ma.asarray(one, float), np.nan) for one in offsets], -1)
    hidden = ~view.is_visible(positions)
    try:
        # What is masked is not drawn; sizes and colours keep their order.
        points._offsets3d = tuple(np.ma.masked_array(one, hidden) for one in positions.T)
        points.do_3d_projection()
        draw(renderer)
    finally:
        points._offsets3d = offsets


def _draw_nothing(renderer: RendererBase) -> None:
    """Draw nothing: the artist of the scene draws what it hides."""
