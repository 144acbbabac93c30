"""The result of a render: requested outputs, statistics and plan."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Mapping
from dataclasses import InitVar, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from rasterjit.io import images
from rasterjit.outputs import save as saving
from rasterjit.outputs.colorbar import Extend, append_bar, draw_colorbar, find_scale, read_bar_title
from rasterjit.outputs.diagnostics import Diagnostics
from rasterjit.outputs.output_table import OUTPUTS, IdOutput, OutputName, Outputs, is_attribute
from rasterjit.outputs.scale_bar import draw_scale_bar
from rasterjit.scene import notebook_preview
from rasterjit.scene import validation as check
from rasterjit.scene.hooks import call_higher_level
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.scene.quality import Quality
from rasterjit.scene.section import planes_in
from rasterjit.survey.plan import RenderPlan

if TYPE_CHECKING:
    from rasterjit.outputs.learning_tuples import PyTorch3DFragments
    from rasterjit.outputs.masks import ObjectMask


RowsAndColumns = tuple[slice, slice]
"""Rows and columns of a picture."""


class OutputNotRequestedError(AttributeError, ValueError):
    """An output was read that the render was not asked for."""


@dataclass(frozen=True, repr=False)
class FrameStats:
    """
    Counts of triangles by fate, and the time of each stage.

    ``triangles_in`` is the sum of ``outside``, ``culled``, ``degenerate``, ``unsampled``,
    ``invalid`` and ``drawn``.

    Parameters
    ----------
    face_id : (H, W) int32, or int
        -1 where nothing is; let go when its pixels have been counted. Or how many show a face.
    """

    triangles_in: int
    outside: int
    """Wholly outside the view volume."""
    culled: int
    """Facing away from the viewer, with culling on."""
    degenerate: int
    """Without area once their vertices are snapped."""
    unsampled: int
    """So small that they cover no pixel's centre, or outside the image."""
    invalid: int
    """With a vertex that is NaN, infinite or beyond 1e150 in clip space."""
    drawn: int
    clipped: int
    """Cut at the near or far plane or the guard band; counted by their outcome as well."""
    seconds: dict[str, float]
    """Seconds of each stage, in order; ``compile`` is apart and not part of any other. Batches and
    recorded frames of a `Renderer` run ``all stages`` in one."""
    face_id: InitVar[NDArray[np.int32] | int]

    def __post_init__(self, face_id: NDArray[np.int32] | int) -> None:
        self.__dict__["_covered"] = face_id

    def __repr__(self) -> str:
        names = [field.name for field in fields(self)]
        names.insert(names.index("seconds"), "pixels_covered")
        return f"FrameStats({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    @property
    def pixels_covered(self) -> int:
        """
        Pixels that show a face; counted when first asked for.

        0 if only edges are drawn and no other output needs the faces.
        """
        covered = self.__dict__["_covered"]
        if not isinstance(covered, int):
            covered = self.__dict__["_covered"] = int(np.count_nonzero(covered >= 0))
        return covered

    def crop(self, slices: RowsAndColumns, face_id: NDArray[np.int32] | None) -> FrameStats:
        """Return the statistics with the covered pixels of a crop."""
        faces = self.__dict__["_covered"] if face_id is None else face_id
        return replace(self, face_id=faces if isinstance(faces, int) else faces[slices].copy())


@dataclass(frozen=True, repr=False)
class QualityChoice(notebook_preview.TextReport):
    """
    The quality that was chosen for a frame, with predicted and actual cost.

    Attributes
    ----------
    quality : Quality
    predicted_seconds : float or None
        Expected time of the frame; ``None`` if it was not known.
    seconds : float
        Actual time, without compiling.
    predicted_error : float or None
        Expected largest root mean square difference from the reference in linear light, if an error
        was requested.
    """

    quality: Quality
    predicted_seconds: float | None
    seconds: float
    predicted_error: float | None = None

    def __str__(self) -> str:
        parts = [f"{self.quality} in {1e3 * self.seconds:.3g} ms"]
        if self.predicted_seconds is not None:
            parts.append(f"{1e3 * self.predicted_seconds:.3g} ms expected")
        if self.predicted_error is not None:
            parts.append(f"error {self.predicted_error:.2g} expected")
        return f"QualityChoice({', '.join(parts)})"


class PickedPixel(NamedTuple):
    """
    The surface point at a pixel's centre, as `Frame.pick` returns it.

    Attributes
    ----------
    node : int
        Index of the object in ``scene.nodes`` as that was: a number, as in ``object_id``, no
        `Node`.
    face : int
        Number of the face in the object's mesh: ``scene.nodes[node].mesh.faces[face]``; of the cap
        that a section gives it -1, or -1 minus the number of the plane.
    weights : (3,) float32
        Of the face's vertices, without unit, as in the output barycentric; their sum is 1. Those of
        points, lines and caps are (0, 0, 0).
    position : (3,) float32
        Where the point is, scene units, world space.
    scalar : float or None
        The mesh's scalar there, as the output scalar has it: NaN where the mesh has none; None if
        that output was not asked for.
    """

    node: int
    face: int
    weights: NDArray[np.float32]
    position: NDArray[np.float32]
    scalar: float | None = None


PICK_OUTPUTS: tuple[OutputName, ...] = ("face_id", "barycentric", "position")
"""Outputs that `Frame.pick` reads."""


class RenderedOutputs:
    """
    The outputs of a render as arrays; in a `Batch` each has one axis more, the first, of views.

    What was not asked for raises `OutputNotRequestedError`.
    """

    _HOLDER: ClassVar[str]
    _outputs: dict[str, NDArray[Any]]

    @property
    def color(self) -> NDArray[np.uint8]:
        """(H, W, 4) uint8: red, green, blue in sRGB, and alpha (linear, not premultiplied)."""
        return self._output("color")

    @property
    def linear(self) -> NDArray[np.float32]:
        """(H, W, 4) float32: linear colour, alpha; before tone mapping, overlays and rounding."""
        return self._output("linear")

    @property
    def depth(self) -> NDArray[np.float32]:
        """(H, W) float32: scene units along the viewing axis; ``inf`` where nothing is."""
        return self._output("depth")

    @property
    def face_id(self) -> NDArray[np.int32]:
        """
        (H, W) int32: face number, counted through all objects in order; -1 where nothing is.

        Caps of a section have numbers above those of all faces: see `SectionPlane`.
        """
        return self._output("face_id")

    @property
    def object_id(self) -> NDArray[np.int32]:
        """(H, W) int32: object number in the order of the scene; -1 where nothing is."""
        return self._output("object_id")

    @property
    def barycentric(self) -> NDArray[np.float32]:
        """(H, W, 3) float32: perspective-correct weights of the face's vertices; 0 if nothing."""
        return self._output("barycentric")

    @property
    def uv(self) -> NDArray[np.float32]:
        """(H, W, 2) float32: texture coordinates; NaN where nothing is or an object has none."""
        return self._output("uv")

    @property
    def scalar(self) -> NDArray[np.float32]:
        """
        (H, W) float32: the scalars of the meshes, whatever they are shown by.

        The face's, or that between its vertices, perspective-correct and in float64; beyond float32
        infinite. NaN where nothing is, an object has none, or a corner of the face has NaN.
        """
        return self._output("scalar")

    def attribute(self, name: str) -> NDArray[np.float32]:
        """
        Return an attribute of the meshes, as the output ``attribute:NAME`` shows it.

        Parameters
        ----------
        name : str
            As ``Mesh(attributes=)`` or the output has it: ``attribute:`` may be before it.

        Returns
        -------
        (H, W, D) float32
            The face's value, or that between its vertices, perspective-correct; NaN where nothing
            is or the mesh does not have it.

        Raises
        ------
        OutputNotRequestedError
            If the output was not asked for.
        """
        full = f"{ATTRIBUTE}{check.string('name', name)}"
        return self._output(name if is_attribute(name) and full not in self._outputs else full)

    @property
    def normal(self) -> NDArray[np.float32]:
        """
        (H, W, 3) float32: world-space unit normal of the surface, of the side that is seen.

        Without unit. Interpolated between the normals of the vertices, whatever the shading: those
        that the mesh was given, else the averages of `Mesh.vertex_normals`. 0 where nothing is, and
        where they are zero or cancel.
        """
        return self._output("normal")

    @property
    def position(self) -> NDArray[np.float32]:
        """(H, W, 3) float32: world-space position; NaN where nothing is."""
        return self._output("position")

    @property
    def distance(self) -> NDArray[np.float32]:
        """
        (H, W) float32: scene units from the eye to the point, along the ray; ``inf`` if nothing.

        Lines of sight that are parallel start at the plane of the eye: it is the depth.
        """
        return self._output("distance")

    @property
    def object_position(self) -> NDArray[np.float32]:
        """
        (H, W, 3) float32: model-space position, units of the mesh; NaN where nothing is.

        Of what a skin or morph targets pose, where the point is on the mesh as it was made.
        """
        return self._output("object_position")

    @property
    def nocs(self) -> NDArray[np.float32]:
        """
        (H, W, 3) float32: normalized object coordinates, 0..1; NaN where nothing is.

        The model-space position in the box of the finite vertices that belong to a face of the
        object, whose middle is at (1/2, 1/2, 1/2) and whose diagonal has length 1 [1]_; in any
        pose that of the mesh as it was made.

        References
        ----------
        .. [1] H. Wang and others, "Normalized Object Coordinate Space for Category-Level 6D Object
           Pose and Size Estimation", CVPR 2019.
        """
        return self._output("nocs")

    @property
    def geometric_normal(self) -> NDArray[np.float32]:
        """
        (H, W, 3) float32: world-space unit normal of the face's plane, of the side that is seen.

        Without unit; 0 where nothing is. ``normal`` is interpolated between vertices instead.
        """
        return self._output("geometric_normal")

    @property
    def normal_camera(self) -> NDArray[np.float32]:
        """
        (H, W, 3) float32: ``normal`` in camera space: x right, y up, -z where the camera looks.

        Without unit; 0 where ``normal`` is. Carried by the inverse transpose of
        ``camera.view_matrix()``, and of length 1 whatever that scales.
        """
        return self._output("normal_camera")

    @property
    def position_camera(self) -> NDArray[np.float32]:
        """
        (H, W, 3) float32: position in camera space, scene units; NaN where nothing is.

        x right, y up, -z where the camera looks: the point times ``camera.view_matrix()``. It keeps
        its digits far from the world's origin.
        """
        return self._output("position_camera")

    @property
    def material_id(self) -> NDArray[np.int32]:
        """
        (H, W) int32: number of the object's material as first used in the scene; -1 if nothing.

        Materials that are equal have one number: equal settings, the same name and textures.
        """
        return self._output("material_id")

    @property
    def instance_id(self) -> NDArray[np.int32]:
        """
        (H, W) int32: number of the object among those that share its mesh; -1 where nothing is.

        From 0 in the order of the scene. Objects of one `Mesh` are its instances, while
        ``object_id`` counts through all objects.
        """
        return self._output("instance_id")

    @property
    def coverage(self) -> NDArray[np.float32]:
        """
        (H, W) float32: share of the pixel that any face covers, 0..1, whatever its alpha.

        Of its ``quality.samples``, or of its area with ``"area"``. Cut-out holes are not covered.
        """
        return self._output("coverage")

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all outputs by name."""
        return dict(self._outputs)

    def _output(self, name: str) -> NDArray[Any]:
        return get_output(name, self._outputs, self._HOLDER)


class Frame(RenderedOutputs):
    """
    One rendered frame.

    Only the outputs that were asked for exist; reading another raises an error that names it. Rows
    run from the top; the centre of pixel (column i, row j) is at (i + 0.5, j + 0.5).

    Attributes
    ----------
    plan : RenderPlan
        What was decided for this frame.
    stats : FrameStats
    choice : QualityChoice or None
        Which quality was chosen, where ``max_error`` or ``time_budget`` asked for it.
    number : int or None
        Which camera it is of those that `render_many` was given, from 0.
    """

    _HOLDER = "frame"

    def __init__(
        self,
        outputs: dict[str, NDArray[Any]],
        plan: RenderPlan,
        stats: FrameStats,
        diagnostics: Diagnostics | None = None,
        face_starts: NDArray[np.int64] | None = None,
    ) -> None:
        self._outputs = outputs
        self._face_starts = face_starts
        self.plan = plan
        self.stats = stats
        # Any, so that type checkers let callers that requested a choice use it.
        self.choice: QualityChoice | Any = None
        self.number: int | None = None
        self._white_share = 0.0
        """Share of the visible lit surfaces that is overexposed, 0..1: see ``view_warnings``."""
        self._diagnostics = diagnostics

    def __repr__(self) -> str:
        width, height = self.plan.size
        return f"Frame({width} x {height}: {', '.join(self._outputs)})"

    @property
    def motion(self) -> NDArray[np.float32]:
        """
        (H, W, 2) float32: where the point is now less where it was before, pixels right and down.

        NaN where nothing is, or where the point was not in front of the eye. Subtracting it from a
        pixel's centre leads to its place in the previous picture: backward optical flow is its
        negative.
        """
        return self._output("motion")

    @property
    def motion_visible(self) -> NDArray[np.bool_]:
        """
        (H, W) bool: whether the point was seen before; False where nothing is.

        That is: it was inside the previous picture and its view volume, its face was drawn, and
        nothing hid it. Of what the previous picture shows at the centre of the pixel that held the
        point, another face hides it if its plane is nearer both at that centre, than the plane of
        the point's own face, and at the point. So edges are as fine as pixels.
        """
        return self._output("motion_visible")

    @property
    def diagnostics(self) -> Diagnostics:
        """Counts of faces by fate, and error bounds; needs ``diagnose=True``."""
        if self._diagnostics is None:
            raise OutputNotRequestedError(
                "diagnostics were not made: ask for them with diagnose=True"
            )
        return self._diagnostics

    def save(
        self,
        path: str | Path,
        outputs: Outputs | Mapping[str, Any] | None = None,
        *,
        scale: float | None = None,
        colorbar: bool | str = False,
    ) -> None:
        """
        Write the colour to an image file, or outputs to a file that holds them exactly.

        Parameters
        ----------
        path : str or Path
            The format follows the extension:

            - ``.npz``: arrays by name; ``.npy``: one array.
            - ``.exr`` (needs ``rasterjit[exr]``): float32 channels under the names that other
              programs know: R, G, B, A (linear light, multiplied by alpha), Z for the depth,
              ``normal.X``, ``position.X``, ``uv.U``, ``distance`` and so on; numbers of faces and
              objects as uint32, one more than they are.
            - ``.png`` of any output but the colour: 16 bits a channel, see below.
            - Other images (``.jpg``, ``.webp``, ``.tif`` ...): the colour. JPEG and BMP know no
              transparency.
        outputs : str or iterable of str, optional
            What to write. Default: the colour to an image, everything to the other formats.
        scale : float, optional
            For a ``.png`` of floats: scene units a code; 0.001 stores millimetres of metres. By
            default chosen from this frame's own range, so give it where frames are compared.
        colorbar : bool or str
            Whether a picture of the colour has its `colorbar` to the right; or its title.

        Raises
        ------
        ValueError
            If the format is unknown, the folder does not exist, this frame does not have the
            output, or it does not fit the format, as a transparent pixel does not fit a JPEG.
            Nothing is written.
        ImportError
            If an EXR is asked for and OpenEXR is not installed.
        OSError
            If the system refuses to write the file; what was there before is whole.

        Notes
        -----
        In a 16-bit PNG code 0 is nothing, and the others mean ``code * scale + offset``; both are
        in its text, with the unit. Numbers are one more than they are, normals
        ``32768 + 32767 n``, motion ``32768 + 64 pixels`` as in the KITTI flow benchmark.
        """
        formats = dict.fromkeys((*saving.FORMATS, *images.IMAGE_FORMATS))
        target = images.check_save_path(path, formats)
        suffix = target.suffix.lower()
        is_image = suffix in images.IMAGE_FORMATS
        if outputs is None and is_image:
            self._output("color")
            outputs = "color"
        arrays = saving.select_arrays(self._outputs, outputs)
        title = read_bar_title(colorbar)
        has_bar = colorbar is not False
        if has_bar and (not is_image or list(arrays) != ["color"]):
            raise ValueError(
                "colorbar must be False but for pictures of the colour, got "
                f"{check.short_repr(colorbar)}, {suffix} and outputs {', '.join(arrays)}"
            )
        if has_bar:
            images.save_image(target, append_bar(self.color, self.colorbar(title)))
        elif suffix in saving.FORMATS:
            saving.save_outputs(target, arrays, scale=scale)
        elif list(arrays) == ["color"] and scale is None:
            images.save_image(target, self.color)
        else:
            raise ValueError(
                f"path {str(path)!r}: {suffix} holds the colour alone, without a scale; "
                f"got outputs {', '.join(arrays)}: choose one of {', '.join(saving.FORMATS)}"
            )

    def show(self, title: str = "") -> None:
        """
        Show the colour: in a notebook's cell, else in the system's picture viewer, else as text.

        In a terminal without a display it is drawn with kitty's graphics or sixels, if
        ``rasterjit[terminal]`` is installed and the terminal has them, else with half blocks.

        Parameters
        ----------
        title : str
            Of the window, where the picture viewer has one. Default: the size of the picture.

        Raises
        ------
        OutputNotRequestedError
            If the colour was not asked for.
        ValueError
            If there is no notebook, no display with a picture viewer, and no terminal.

        See Also
        --------
        rasterjit.show : Turn a scene by hand.
        """
        check.string("title", title)
        call_higher_level("show_picture", self, self.color, title or self.caption)

    @property
    def caption(self) -> str:
        """One line for people: ``640 × 480, 7,656 triangles, 12 ms``; without compiling."""
        width, height = self.plan.size
        seconds = sum(time for name, time in self.stats.seconds.items() if name != "compile")
        duration = f"{seconds:.1f} s" if seconds >= 1.0 else f"{1e3 * seconds:.0f} ms"
        return f"{width} × {height}, {self.counted}, {duration}"

    @property
    def counted(self) -> str:
        """The drawn primitives in words: ``7,656 triangles``, ``90 triangles and points``."""
        contents, count = self.plan.facts.counts, self.stats.triangles_in
        kinds = {"segments": contents.lines, "points": contents.points}
        mesh_count = contents.objects - sum(kinds.values())
        kinds = {"triangles": mesh_count if any(kinds.values()) else 1} | kinds
        names = [name.removesuffix("s" if count == 1 else "") for name, n in kinds.items() if n]
        return f"{count:,} {' and '.join(', '.join(names).rsplit(', ', 1))}"

    def colorbar(
        self, title: str = "", *, unit: str = "", extend: Extend | None = None,
        node: int | None = None, font: str | os.PathLike[str] | None = None,
    ) -> NDArray[np.uint8]:  # fmt: skip
        """
        Draw the colour bar of the scalars, as high as the frame, the highest value on top.

        Ticks lie at round numbers, powers of ten, bounds or categories, as the scalars' norm and
        colour map have them. If any scalar is NaN, its colour is shown as well.

        Parameters
        ----------
        title : str
            Stands above the bar.
        unit : str
            Stands under the title, behind the factor of the numbers if they have one.
        extend : {"neither", "min", "max", "both"}, optional
            Which ends are arrows, in the colours of what lies beyond. Default: those beyond which
            there are values.
        node : int, optional
            Index in ``scene.nodes`` of the object whose bar it is. Default: all objects with
            scalars must have one colormap, norm and range.
        font : str or path, optional
            Of its texts, as `Label` takes it.

        Returns
        -------
        (H, W, 4) uint8
            sRGB, black on white; as wide as its labels make it.

        Raises
        ------
        ValueError
            If no object has scalars, the node has none, or several bars are meant.
        """
        check.string("title", title)
        scale = find_scale(self.plan.facts.inventory.color_scales, node)
        check.string("unit", unit)
        return draw_colorbar(scale, self.plan.size[1], title, font, unit=unit, extend=extend)

    def scale_bar(
        self, unit: str = "", *, per_unit: float = 1.0, depth: float | None = None,
        arrow: bool = False, font: str | os.PathLike[str] | None = None,
    ) -> NDArray[np.uint8]:  # fmt: skip
        """
        Draw a bar of a round length with its text, on a strip as wide as the frame.

        Parameters
        ----------
        unit : str
            Stands behind the number.
        per_unit : float
            Scene units a unit of the number: 0.001 for millimetres where the scene is in metres;
            the ``scale`` of `Arrows` for the length of their vectors.
        depth : float, optional
            Distance along the viewing axis at which it is right, scene units. Needed where the
            camera has a perspective; without, the scale is the same all over.
        arrow : bool
            Whether it is an arrow, as a key to vectors.
        font : str or path, optional
            Of the text, as `Label` takes it.

        Returns
        -------
        (H, W, 4) uint8
            sRGB, black on white.

        Raises
        ------
        ValueError
            If a number is not above 0, ``depth`` is missing, or the camera is a lens.

        Examples
        --------
        >>> import rasterjit as rj
        >>> scene = rj.load("models/teapot.obj")
        >>> camera = rj.fit_camera(scene, projection="orthographic")
        >>> frame = rj.render(scene, camera, size=(320, 240))
        >>> sheet = rj.grid([frame, frame.scale_bar("cm")], 1, gap=0)
        """
        return draw_scale_bar(
            self.plan.camera, self.plan.size, check.string("unit", unit),
            check.positive_number("per_unit", per_unit), depth, check.boolean("arrow", arrow), font,
        )  # fmt: skip

    def masks(self, output: IdOutput = "object_id") -> tuple[ObjectMask, ...]:
        """
        Return the pixels of each object that is seen, with its box, its area and its COCO code.

        Parameters
        ----------
        output : str
            Output of whole numbers that tells things apart: ``"object_id"``, ``"face_id"``, ...

        Returns
        -------
        tuple of ObjectMask
            In the order of the numbers; see `rasterjit.masks`.

        Raises
        ------
        ValueError
            If this frame does not have the output, or it holds no whole numbers.
        """
        from rasterjit.outputs.masks import find

        ids = self._output(check.string("output", output))
        if ids.ndim != 2 or ids.dtype.kind not in "iu":
            listed = ", ".join(map(repr, get_args(IdOutput)))
            raise ValueError(f"output must be one of {listed}, got {check.brief(output)}")
        return find(ids)

    def pick(self, x: float, y: float) -> PickedPixel | None:
        """
        Return what the centre of a pixel shows.

        Parameters
        ----------
        x, y : float
            Column and row, from the left and the top. Fractions, as of a mouse, are a point in the
            picture: the pixel is the one that holds it, 160 for 160.7.

        Returns
        -------
        PickedPixel or None
            Object, face, weights (those of points and lines are (0, 0, 0)) and world position, and
            the scalar if the output scalar was asked for; ``None`` where nothing is.

        Raises
        ------
        OutputNotRequestedError
            If face_id, barycentric or position was not asked for.
        ValueError
            If the pixel is outside the frame, or a number is NaN.
        """
        return self._pick(x, y, ())

    def _pick(self, x: float, y: float, layer: tuple[int, ...]) -> PickedPixel | None:
        """Return the surface point of a pixel, in a layer if there are several."""
        face_id, weights, position = (all_[layer] for all_ in self._require("pick", PICK_OUTPUTS))
        height, width = face_id.shape
        pixel = _find_pixel("y", y, height), _find_pixel("x", x, width)
        face = int(face_id[pixel])
        if face < 0:
            return None
        starts = self._find_first_faces()
        node = int(np.searchsorted(starts, face, side="right")) - 1
        face_number = face - int(starts[node])
        if node == len(starts) - 1:
            # A cap: those of an object, one for each plane, follow each other.
            node, plane = divmod(face_number, len(planes_in(self.plan.facts.fields["section"])))
            face_number = -1 - plane
        scalar = self._outputs.get("scalar")
        return PickedPixel(
            node, face_number, weights[pixel].copy(), position[pixel].copy(),
            None if scalar is None else float(scalar[layer][pixel]),
        )  # fmt: skip

    def to_pytorch3d(self, what: Any = None) -> PyTorch3DFragments:
        """
        Return what PyTorch3D's ``MeshRasterizer`` returns, as arrays.

        Rows run from the top there, too, though its axes are x left and y up. For its camera see
        `rasterjit.cameras.to_pytorch3d`.

        Parameters
        ----------
        what : Scene or Mesh, optional
            What was drawn, as it was then: ``dists`` needs the vertices, which a frame does not
            keep. Default: ``dists`` is ``None``.

        Returns
        -------
        PyTorch3DFragments

        Raises
        ------
        OutputNotRequestedError
            If face_id, barycentric or depth was not asked for.
        ValueError
            If the frame shows points, lines or caps of a section, or ``what`` has other faces; with
            ``what``, if a lens drew it.
        """
        from rasterjit.outputs.learning_tuples import make_pytorch3d

        return make_pytorch3d(self, what)

    def to_nvdiffrast(self) -> NDArray[np.float32]:
        """
        Return what nvdiffrast's ``rasterize`` returns first, as an array.

        Returns
        -------
        (H, W, 4) float32
            u and v, the perspective-correct weights of the face's first and second vertex; z/w of
            ``plan.camera.projection_matrix(plan.size)``, -1..1; the face's number and 1. All 0
            where nothing is. Row 0 is at the bottom, as in OpenGL.

        Raises
        ------
        OutputNotRequestedError
            If face_id, barycentric or depth was not asked for.
        ValueError
            If the frame shows points, lines or caps of a section, or a lens drew it.

        Notes
        -----
        Numbers above 16777216 have nvdiffrast's code for what float32 does not hold.
        """
        from rasterjit.outputs.learning_tuples import make_nvdiffrast

        return make_nvdiffrast(self)

    def _require(self, user: str, names: tuple[str, ...]) -> list[NDArray[Any]]:
        """Return the outputs that something needs, or raise ``OutputNotRequestedError``."""
        missing = [name for name in names if name not in self._outputs]
        if missing:
            raise OutputNotRequestedError(
                f"{user} needs the outputs {', '.join(names)}; {' and '.join(missing)} "
                f"{'was' if len(missing) == 1 else 'were'} not rendered: ask for them with "
                f"outputs=(..., {', '.join(map(repr, missing))})"
            )
        return [self._outputs[name] for name in names]

    def _find_first_faces(self) -> NDArray[np.int64]:
        """Return the number of each object's first face, (O+1,)."""
        if self._face_starts is None:
            raise ValueError("expected a frame that was rendered, got one made of arrays")
        return self._face_starts

    def _repr_png_(self) -> bytes | None:
        """Show the colour in a notebook."""
        if "color" not in self._outputs:
            return None
        import imageio.v3 as iio

        data = io.BytesIO()
        iio.imwrite(data, self.color, extension=".png")
        return data.getvalue()

    def _repr_mimebundle_(
        self, include: Any = None, exclude: Any = None
    ) -> notebook_preview.Bundle:
        """Show the colour in a notebook, its size and time under it, and an alternative text."""
        return notebook_preview.mime_bundle(
            self._repr_png_(), f"Picture of {self!r}", caption=self.caption
        )


def get_output(name: str, outputs: Mapping[str, NDArray[Any]], holder: str) -> NDArray[Any]:
    """Return an output of a frame or batch; raise ``OutputNotRequestedError`` if it is missing."""
    if name in outputs:
        return outputs[name]
    available = f"this {holder} has {', '.join(outputs)}"
    if name not in OUTPUTS and not is_attribute(name):
        hint = check.suggest(name, (*OUTPUTS, *outputs))
        raise OutputNotRequestedError(
            f"{check.brief(name)} is the name of no output; {available}{hint}"
        )
    hint = ""
    if is_attribute(name):
        # Compare without the common prefix.
        attributes = [other.removeprefix(ATTRIBUTE) for other in outputs if is_attribute(other)]
        hint = check.suggest(name.removeprefix(ATTRIBUTE), attributes)
    raise OutputNotRequestedError(
        f"{name} was not rendered: ask for it with outputs=(..., {name!r}); {available}{hint}"
    )


def _find_pixel(name: str, value: Any, count: int) -> int:
    """Return the column or row that holds a point, or raise ``ValueError``."""
    if isinstance(value, (float, np.floating)):
        if not 0.0 <= value < count:
            raise ValueError(
                f"{name} must be a point in the picture, at least 0 and below {count}, got {value}"
            )
        value = math.floor(value)
    return check.index_below(name, value, count)


class LayeredFrame(Frame):
    """
    The nearest surfaces of each pixel, one behind the other; `render_layers` returns it.

    Outputs are those of a `Frame` with an axis of K layers in front, nearest first: ``depth`` is
    (K, H, W), ``normal`` (K, H, W, 3), and so on. Where a pixel has fewer surfaces they hold what
    they hold where nothing is.

    Attributes
    ----------
    plan : RenderPlan
    stats : FrameStats
        Of the first layer.
    """

    def __repr__(self) -> str:
        width, height = self.plan.size
        count = self.plan.surfaces
        return f"LayeredFrame({count} layers, {width} x {height}: {', '.join(self._outputs)})"

    def save(
        self,
        path: str | Path,
        outputs: Outputs | Mapping[str, Any] | None = None,
        *,
        scale: float | None = None,
        colorbar: bool | str = False,
    ) -> None:
        """
        Write all layers of outputs to a file that holds them exactly.

        Parameters
        ----------
        path : str or Path
            The format follows the extension: ``.npz`` (arrays by name, (K, H, W, ...)), ``.npy``
            (one array), or ``.exr`` (needs ``rasterjit[exr]``): the channels of `Frame.save` for
            each layer, ``layer0.Z``, ``layer1.normal.X`` and so on.
        outputs : str or iterable of str, optional
            What to write. Default: everything.
        scale : None
            For pictures, which hold no layers.
        colorbar : bool
            For pictures too: False.

        Raises
        ------
        ValueError
            If the format holds no layers, the folder does not exist, this frame does not have the
            output, or it does not fit the format. Nothing is written.
        ImportError
            If an EXR is asked for and OpenEXR is not installed.
        OSError
            If the system refuses to write the file; what was there before is whole.
        """
        if scale is not None:
            raise ValueError(f"scale must be None for layers, got {scale!r}")
        if colorbar is not False:
            raise ValueError(f"colorbar must be False for layers, got {check.brief(colorbar)}")
        saving.save_layers(path, saving.select_arrays(self._outputs, outputs))

    def pick(self, x: float, y: float, layer: int = 0) -> PickedPixel | None:
        """
        Return what the centre of a pixel shows in a layer; takes what `Frame.pick` takes.

        Parameters
        ----------
        x, y : float
        layer : int
            0 is the nearest.
        """
        return self._pick(x, y, (check.index_below("layer", layer, self.plan.surfaces or 1),))

    def masks(self, output: IdOutput = "object_id") -> tuple[ObjectMask, ...]:
        """
        Raise ``ValueError``: a mask is of one layer.

        Raises
        ------
        ValueError
            That says how to find those of a layer.
        """
        self._output(output)
        raise ValueError(
            f"masks are of one layer, and this frame has {self.plan.surfaces}: use "
            f"rasterjit.masks.find(frame.{output}[0]) for the first"
        )


def crop_frame(frame: Frame, slices: RowsAndColumns, plan: RenderPlan) -> Frame:
    """Return a crop of a frame, with the crop's plan."""
    arrays = {name: array[slices].copy() for name, array in frame.arrays().items()}
    stats = frame.stats.crop(slices, frame.arrays().get("face_id"))
    return Frame(arrays, plan, stats, None, frame._face_starts)


def select_outputs(frame: Frame, outputs: tuple[str, ...]) -> Frame:
    """Return a frame with only the named outputs."""
    arrays = frame.arrays()
    plan = frame.plan.for_picture(facts=replace(frame.plan.facts, outputs=outputs))
    selected = Frame(
        {name: arrays[name] for name in outputs}, plan, frame.stats, frame._diagnostics,
        frame._face_starts,
    )  # fmt: skip
    selected.choice = frame.choice
    if "color" in outputs:
        selected._white_share = frame._white_share
    return selected
