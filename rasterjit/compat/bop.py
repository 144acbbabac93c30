"""
Draw object models by the renderer interface of the BOP toolkit, without OpenGL.

>>> from rasterjit.compat import bop as renderer
>>> drawer = renderer.create_renderer(640, 480, mode="depth")

In the toolkit's scripts the first line replaces ``from bop_toolkit_lib.rendering import renderer``.
Depth, light and colours follow the formulas of its renderers. They draw by OpenGL, which has the
centres of pixels at halves: there ``cx`` and ``cy`` count from the first pixel's corner, and so
they do here. BOP's ``cam_K`` is OpenCV's, which counts from that pixel's centre:
``pixel_center=0.0`` draws what it means.

References
----------
.. [1] BOP toolkit, ``bop_toolkit_lib.rendering.renderer`` and ``renderer_vispy``; bop_renderer,
   ``GPUBuffer::calculateProjectionMatrix``.
"""

from __future__ import annotations

import os
from collections.abc import Hashable
from dataclasses import replace
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.io.cameras import from_opencv
from rasterjit.io.images import quantize
from rasterjit.io.meshes import load
from rasterjit.outputs.output_table import OutputName
from rasterjit.rendering.renderer import Renderer as Engine
from rasterjit.scene import transforms
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import compute_area_vectors, dot_rows
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.validation import bounded_number, brief, finite_array, image_size, one_of

__all__ = ["Renderer", "create_renderer"]

Mode: TypeAlias = Literal["rgb+depth", "rgb", "depth"]
MODES: tuple[Mode, ...] = get_args(Mode)

Shading: TypeAlias = Literal["phong", "flat"]
SHADINGS: tuple[Shading, ...] = get_args(Shading)
"""Normals that light falls on: those of vertices, interpolated; of faces, towards the camera."""

RENDERER_TYPES = ("cpp", "vispy", "python")
"""Names of the toolkit's renderers whose pictures these are."""

LIT_OUTPUTS: dict[Shading, tuple[OutputName, ...]] = {
    "phong": ("linear", "position", "geometric_normal", "normal", "face_id"),
    "flat": ("linear", "position", "geometric_normal"),
}
"""Outputs that light is computed from."""

GREY = 0.5
"""Code, 0..1, of a model without colours."""


def create_renderer(
    width: int, height: int, renderer_type: str = "cpp", mode: Mode = "rgb+depth",
    shading: Shading = "phong", bg_color: ArrayLike = (0.0, 0.0, 0.0, 0.0),
) -> Renderer:  # fmt: skip
    """
    Return a `Renderer`; takes what the toolkit's function takes.

    Parameters
    ----------
    width, height : int, pixels
    renderer_type : {"cpp", "vispy", "python"}
        One renderer stands for all of them.
    mode, shading, bg_color
        As for `Renderer`.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    one_of("renderer_type", renderer_type, RENDERER_TYPES)
    return Renderer(width, height, mode, shading, bg_color)


class _Model(NamedTuple):
    """A model that was added."""

    scene: Scene
    fronts: NDArray[np.float64]
    """(F, 3): vectors to the front of each face."""


class Renderer:
    """
    Draws one model at a time, in the pose of BOP's ``cam_R_m2c`` and ``cam_t_m2c``.

    Parameters
    ----------
    width, height : int, pixels
    mode : {"rgb+depth", "rgb", "depth"}
        What `render_object` returns.
    shading : {"phong", "flat"}
        Whether light falls on the normals of vertices, interpolated, or on those of faces.
    bg_color : (4,) or (3,) array_like
        Codes of the background, 0..1; alpha has no effect.
    pixel_center : float
        Where the centre of the first pixel is in the coordinates of ``cx`` and ``cy``: 0.5 as in
        the toolkit's renderers; 0 as in OpenCV, which BOP's ``cam_K`` follows.
    threads : int, optional
        Default: all processors. The pictures have the same bits for any number.

    Attributes
    ----------
    light_cam_pos : (float, float, float)
        Where the point light is, OpenGL's camera space: x right, y up, z backwards.
    light_ambient_weight : float
        Share of a colour that is seen without that light, 0..1.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """

    def __init__(
        self, width: int, height: int, mode: Mode = "rgb+depth", shading: Shading = "phong",
        bg_color: ArrayLike = (0.0, 0.0, 0.0, 0.0), *, pixel_center: float = 0.5,
        threads: int | None = None,
    ) -> None:  # fmt: skip
        self.width, self.height = image_size("width, height", (width, height))
        self.mode: Mode = one_of("mode", mode, MODES)
        self.shading: Shading = one_of("shading", shading, SHADINGS)
        color = _check_codes("bg_color", bg_color, (3, 4))
        self.bg_color = tuple(color.tolist())
        self.pixel_center = bounded_number("pixel_center", pixel_center, 0.0, 1.0)
        self.light_cam_pos = (0.0, 0.0, 0.0)
        self.light_ambient_weight = 0.5
        self._models: dict[Hashable, _Model] = {}
        self._engine = Engine((self.width, self.height), quality=Quality(), threads=threads)
        self._engine.warned = None

    def set_light_cam_pos(self, light_cam_pos: ArrayLike) -> None:
        """
        Place the point light, in OpenGL's camera space: x right, y up, z backwards.

        Raises
        ------
        ValueError
            If it is not three finite numbers.
        """
        position = finite_array("light_cam_pos", light_cam_pos, (3,))
        self.light_cam_pos = tuple(position.tolist())

    def set_light_ambient_weight(self, light_ambient_weight: float) -> None:
        """
        Set the share of a colour, 0..1, that is seen where the light does not fall.

        Raises
        ------
        ValueError
            If it is not a number from 0 to 1.
        """
        self.light_ambient_weight = bounded_number(
            "light_ambient_weight", light_ambient_weight, 0.0, 1.0
        )

    def add_object(
        self, obj_id: Hashable, model_path: str | os.PathLike[str],
        surf_color: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        """
        Load a model, in the place of one of the same id.

        Parameters
        ----------
        obj_id : int
        model_path : path
            Any mesh file; its unit is the unit of depth, in BOP millimetres.
        surf_color : (3,) array_like, optional
            Codes, 0..1, of the whole model. Default: its texture, the colours of its vertices, or
            grey.

        Raises
        ------
        ValueError
            If the file cannot be read or ``surf_color`` is no colour.
        """
        color = None if surf_color is None else _check_codes("surf_color", surf_color, (3,))
        loaded, scene = load(model_path), Scene()
        for node in loaded.nodes:
            scene.add(_show_codes(node.mesh, color), node.world_matrix)
        fronts = np.concatenate([_find_fronts(node) for node in scene.nodes])
        self._models[obj_id] = _Model(scene, fronts)

    def remove_object(self, obj_id: Hashable) -> None:
        """
        Forget a model.

        Raises
        ------
        ValueError
            If there is none of that id.
        """
        self._find_model(obj_id)
        del self._models[obj_id]

    def render_object(
        self, obj_id: Hashable, R: ArrayLike, t: ArrayLike, fx: float, fy: float, cx: float,
        cy: float,
    ) -> dict[str, NDArray[Any]]:  # fmt: skip
        """
        Draw a model.

        Parameters
        ----------
        obj_id : int
            That of `add_object`.
        R : (3, 3) array_like
            Rotation of the model to OpenCV's camera: x right, y down, z ahead.
        t : (3,) or (3, 1) array_like
            Translation, in the model's unit.
        fx, fy, cx, cy : float, pixels
            Focal lengths and principal point, which may lie beside the picture.

        Returns
        -------
        dict
            By the mode ``"rgb"``, (H, W, 3) uint8, and ``"depth"``, (H, W) float32: along the
            viewing axis, in the model's unit, 0 where nothing is.

        Raises
        ------
        ValueError
            Naming the argument that is wrong.
        """
        model = self._find_model(obj_id)
        shift = 0.0 - self.pixel_center
        camera = from_opencv(
            [[fx, 0.0, cx + shift], [0.0, fy, cy + shift], [0.0, 0.0, 1.0]],
            (self.width, self.height), rotation=R, translation=t,
        )  # fmt: skip
        outputs = () if self.mode == "depth" else LIT_OUTPUTS[self.shading]
        frame = self._engine.render(model.scene, camera, outputs=("depth", *outputs))
        is_seen = np.isfinite(frame.depth)
        result: dict[str, NDArray[Any]] = {}
        if self.mode != "depth":
            seen = np.flatnonzero(is_seen)
            result["rgb"] = self._light(model, frame.arrays(), seen, camera.view_from_world)
        if self.mode != "rgb":
            result["depth"] = np.where(is_seen, frame.depth, np.float32(0.0))
        return result

    def _find_model(self, obj_id: Hashable) -> _Model:
        """Return a model, or raise ``ValueError``."""
        try:
            return self._models[obj_id]
        except (KeyError, TypeError):
            known = ", ".join(map(repr, self._models)) or "no object"
            raise ValueError(
                f"obj_id must be one that add_object was given ({known}), got {brief(obj_id)}"
            ) from None

    def _light(
        self, model: _Model, arrays: dict[str, NDArray[Any]], seen: NDArray[np.int64],
        view: NDArray[np.float64],
    ) -> NDArray[np.uint8]:  # fmt: skip
        """Return the lit picture: codes times ambient plus diffuse light, at most 1 together."""
        rows = {name: array.reshape(self.height * self.width, -1) for name, array in arrays.items()}
        positions = transforms.transform_points(view, rows["position"][seen])[:, :3]
        normals = rows["geometric_normal"][seen]
        if self.shading == "phong":
            # Ours face the eye; the toolkit's are those of the front, on back faces too.
            is_back = dot_rows(model.fronts[rows["face_id"][seen, 0]], normals) < 0.0
            normals = np.where(is_back[:, None], -1.0, 1.0) * rows["normal"][seen]
        rotation = view.copy()
        rotation[:3, 3] = 0.0
        normals = transforms.transform_points(rotation, normals)[:, :3]
        to_light = np.array(self.light_cam_pos) - positions
        cosine = dot_rows(normals, to_light)
        cosine /= np.maximum(np.sqrt(dot_rows(to_light, to_light)), np.finfo(np.float64).tiny)
        weight = np.minimum(self.light_ambient_weight + np.maximum(cosine, 0.0), 1.0)
        picture = np.empty((len(rows["linear"]), 3), np.uint8)
        picture[:] = _quantize(np.array(self.bg_color[:3]))
        picture[seen] = _quantize(rows["linear"][seen, :3] * weight[:, None])
        return picture.reshape(self.height, self.width, 3)


def _quantize(codes: NDArray[Any]) -> NDArray[np.uint8]:
    """Return codes in 0..1 as bytes, rounded half up."""
    return np.floor(255.0 * codes + 0.5).astype(np.uint8)


def _find_fronts(node: Node) -> NDArray[np.float64]:
    """Return vectors to the front of each face, (F, 3), in the world."""
    vertices = transforms.apply(node.world_matrix, node.mesh.vertices)
    return compute_area_vectors(vertices, node.mesh.faces, 1.0)


def _check_codes(name: str, value: ArrayLike, counts: tuple[int, ...]) -> NDArray[np.float64]:
    """Return a colour of codes in 0..1, or raise ``ValueError``."""
    color = finite_array(name, value, (None,))
    if len(color) not in counts or color.min() < 0.0 or color.max() > 1.0:
        raise ValueError(
            f"{name} must be {' or '.join(map(str, counts))} codes from 0 to 1, got {brief(value)}"
        )
    return color


def _show_codes(mesh: Mesh, color: NDArray[np.float64] | None) -> Mesh:
    """Return a mesh whose own colours, as codes, are the light that it shows."""
    texture, colors, plain = None, None, color
    light = mesh.shown_vertex_colors() if mesh.face_colors is None else mesh.face_colors
    if color is None and mesh.uv is not None:
        texture = mesh.material.base_color_texture
    if texture is not None:
        own: dict[str, Any] = {"image": _encode(texture.image), "color_space": "linear"}
        texture = replace(texture, **own)
    elif color is None and light is not None:
        colors = _encode(light)[:, :3] / 255.0
    elif color is None and mesh.material.base_color is not None:
        plain = _encode(np.array(mesh.material.base_color, np.float32))[:3] / 255.0
    elif color is None:
        plain = np.full(3, GREY)
    return Mesh(
        mesh.vertices, mesh.faces, colors=colors, normals=mesh.normals,
        uv=None if texture is None else mesh.uv,
        material=Material("unlit", base_color=plain, base_color_texture=texture),
    )  # fmt: skip


def _encode(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the sRGB codes of linear colours, (..., 4)."""
    return quantize(light, "srgb")[0]
