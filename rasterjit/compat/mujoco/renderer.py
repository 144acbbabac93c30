"""Render a model as MuJoCo's own renderer does."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from types import TracebackType
from typing import Any, Literal, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.mujoco import shapes
from rasterjit.compat.mujoco.model_scene import (
    FLAG,
    GEOM,
    MAX_SHADOW_TEXELS,
    ModelScene,
    check_state,
    get_texture_picture,
)
from rasterjit.compat.opengl_camera import flip_rows, make_matrix_camera
from rasterjit.rendering.batch import render_batch
from rasterjit.rendering.renderer import Renderer as Engine
from rasterjit.scene.camera import MatrixCamera
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import Texture
from rasterjit.scene.validation import brief, sequence, whole_number
from rasterjit.scene.warning import REPEATED, silence_warnings

Mode: TypeAlias = Literal["linear", "depth", "object_id"]

SAMPLE_COUNTS: tuple[Literal[1, 2, 4, 8, 16], ...] = (1, 2, 4, 8, 16)
"""Possible numbers of samples in a pixel."""

SHADOW_TEXELS_PER_PIXEL = 4
"""Texels along a shadow map for each pixel along the picture's longer side."""

MAX_SINGLE_THREAD_PIXELS = 1 << 16
"""Pixels of a picture up to which several threads are not faster."""

SKY_DISTANCE_SHARE = 0.7
"""Distance of the sky, as a share of the far plane's."""

PIXEL_TYPES: dict[Mode, tuple[tuple[int, ...], type]] = {
    "linear": ((3,), np.uint8), "depth": ((), np.float32), "object_id": ((2,), np.int32),
}  # fmt: skip
"""Shape and type of a pixel of colours, depth and numbers."""


class Renderer:
    """
    Renders a model's scenes of one size: ``mujoco.Renderer`` without OpenGL.

    Parameters
    ----------
    model : mujoco.MjModel
    height, width : int, pixels
        At most the model's ``vis.global_.offheight`` and ``offwidth``, as in MuJoCo.
    max_geom : int
        Capacity of MuJoCo's list of geoms.
    threads : int, optional
        Default: all processors, but one for `render` of pictures of up to 65536 pixels.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """

    def __init__(
        self, model: Any, height: int = 240, width: int = 320, max_geom: int = 10000,
        *, threads: int | None = None,
    ) -> None:  # fmt: skip
        if not isinstance(model, mujoco.MjModel):
            raise ValueError(f"model must be a mujoco.MjModel, got {brief(model)}")
        settings = model.vis.global_
        for name, value, limit in (
            ("height", height, settings.offheight),
            ("width", width, settings.offwidth),
        ):
            if whole_number(name, value, 1, 16384) > limit:
                raise ValueError(
                    f"{name} must be at most {limit}, which the model sets by "
                    f'<visual><global off{name}="{limit}"/></visual>, got {value}'
                )
        self._height, self._width = int(height), int(width)
        self._scene = ModelScene(model, whole_number("max_geom", max_geom, 1, 1 << 24), True)
        samples = max(s for s in SAMPLE_COUNTS if s <= max(1, model.vis.quality.offsamples))
        self._qualities = {
            "linear": Quality(samples=samples), "depth": Quality(subpixel_bits=12),
            # As Mesa rounds vertices.
            "object_id": Quality(subpixel_bits=8),
        }  # fmt: skip
        size = self._width, self._height
        self._scene._shadow_size = min(MAX_SHADOW_TEXELS, SHADOW_TEXELS_PER_PIXEL * max(size))
        self._threads = threads
        if threads is None and size[0] * size[1] <= MAX_SINGLE_THREAD_PIXELS:
            threads = 1
        self._engines = {
            name: Engine(size, quality=quality, threads=threads)
            for name, quality in {
                **self._qualities, "mirrored": self._qualities["linear"], "sky": Quality()
            }.items()
        }  # fmt: skip
        for engine in self._engines.values():
            engine.warned = None
        self._sky = _make_sky(model)
        self._sky_picture: tuple[Any, NDArray[np.float32]] | None = None
        self._mirrored_scene, self._numbered_scene = Scene(), Scene()
        self._numbered_rows: Any = None
        self._mode: Mode = "linear"
        self._is_closed = False

    @property
    def model(self) -> Any:
        """The model."""
        return self._scene._model

    @property
    def scene(self) -> Any:
        """MuJoCo's scene, whose flags, geoms and lights may be changed after `update_scene`."""
        return self._scene._geom_scene

    @property
    def height(self) -> int:
        """Height of the picture, pixels."""
        return self._height

    @property
    def width(self) -> int:
        """Width of the picture, pixels."""
        return self._width

    def enable_depth_rendering(self) -> None:
        """Make `render` return depth."""
        self._mode = "depth"

    def disable_depth_rendering(self) -> None:
        """Make `render` return colours again."""
        self._mode = "linear" if self._mode == "depth" else self._mode

    def enable_segmentation_rendering(self) -> None:
        """Make `render` return numbers and types of objects."""
        self._mode = "object_id"

    def disable_segmentation_rendering(self) -> None:
        """Make `render` return colours again."""
        self._mode = "linear" if self._mode == "object_id" else self._mode

    def update_scene(self, data: Any, camera: Any = -1, scene_option: Any = None) -> None:
        """
        Let MuJoCo list the geoms of a state of the simulation, for `render`.

        Parameters
        ----------
        data : mujoco.MjData
        camera : int, str or mujoco.MjvCamera
            By number or name; -1 is the free camera.
        scene_option : mujoco.MjvOption, optional
            Selects what is drawn.

        Raises
        ------
        RuntimeError
            After `close`.
        ValueError
            If there is no such camera, the state is of another model, or an argument is of another
            kind.
        """
        self._check_open("update_scene")
        self._scene.list_geoms(data, camera, scene_option)

    def render(self, *, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """
        Render the scene.

        Parameters
        ----------
        out : array, optional
            Array for the result, of its shape and type.

        Returns
        -------
        (H, W, 3) uint8, or
        (H, W) float32
            With depth rendering: along the viewing axis, in units of the model; that of the far
            plane in empty pixels.
        (H, W, 2) int32
            With segmentation: number and type (``mujoco.mjtObj``) of the object, -1 for none.

        Raises
        ------
        RuntimeError
            After `close`.
        ValueError
            If ``out`` is no writable array of that shape and type.
        """
        self._check_open("render")
        pixel_shape, dtype = PIXEL_TYPES[self._mode]
        shape = self._height, self._width, *pixel_shape
        picture = np.empty(shape, dtype) if out is None else out
        if not isinstance(picture, np.ndarray) or (picture.shape, picture.dtype) != (shape, dtype):
            expected = f"an array of {np.dtype(dtype)} with shape {shape}"
            raise ValueError(f"out must be {expected}, got {brief(picture)}")
        if not picture.flags.writeable:
            raise ValueError("out must be writable, got an array that is read-only")
        # Programs add geoms to the list after update_scene.
        self._scene.update()
        if not self.scene.camera[0].frustum_far:  # Before update_scene.
            self._write_empty(picture)
        elif self._mode == "linear":
            self._draw_colors(self._make_camera(), picture)
        else:
            self._draw_shapes(self._make_camera(), picture)
        return picture

    def render_batch(
        self, states: Iterable[Any], camera: Any = -1, scene_option: Any = None
    ) -> NDArray[Any]:
        """
        Render many states of the simulation, such as those of as many environments, in one call.

        Returns
        -------
        (N, ...) array
            The result of `render` for each state.

        Raises
        ------
        RuntimeError
            After `close`.
        ValueError
            If MuJoCo lists other geoms for one of them than for the first, or an argument is wrong
            as it is for `update_scene`.
        """
        self._check_open("render_batch")
        state_list, pixel_shape, dtype = sequence("states", states), *PIXEL_TYPES[self._mode]
        shape = len(state_list), self._height, self._width, *pixel_shape
        pictures: NDArray[Any] = np.empty(shape, dtype)
        if not state_list:
            return pictures
        # The poses, camera and lights of each state.
        transforms, cameras, lights = [], [], []
        geometry_key: Any = None
        has_extras = False
        for number, data in enumerate(state_list):
            scene = self._scene
            check_state(f"states[{number}]", data, self.model)
            scene.follow(data, camera, scene_option)
            if geometry_key is None:
                geometry_key = scene.geometry_key
            elif scene.geometry_key != geometry_key:
                raise ValueError(
                    "states must have the same geoms in the same colours, got others in "
                    f"states[{number}]"
                )
            transforms.append(scene.matrices)
            cameras.append(self._make_camera())
            lights.append(list(scene.lights))
            has_extras = has_extras or self._has_sky_or_mirror()
        # Draw them one by one if they differ in more than poses, else as a batch.
        drawn = self._get_numbered_scene() if self._mode != "linear" else self._scene
        has_own_light = has_extras or lights != lights[:1] * len(lights)
        if self._scene.has_deformed or (self._mode == "linear" and has_own_light):
            for number, data in enumerate(state_list):
                self.update_scene(data, camera, scene_option)
                self.render(out=pictures[number])
        elif not drawn.nodes:
            for picture in pictures:
                self._write_empty(picture)
        else:
            index_of_node = {id(node): n for n, node in enumerate(self._scene.nodes)}
            drawn_indices = [index_of_node[id(node)] for node in drawn.nodes]
            # `render` does not warn of empty views either.
            with silence_warnings(REPEATED):
                batch = render_batch(
                    drawn, cameras, size=(self._width, self._height), outputs=(self._mode,),
                    quality=self._qualities[self._mode], background="black",
                    transforms=np.stack(transforms)[:, drawn_indices], threads=self._threads,
                )  # fmt: skip
            for picture, drawn_picture in zip(pictures, batch.arrays()[self._mode], strict=True):
                self._write_picture(drawn_picture, picture)
        return pictures

    def close(self) -> None:
        """Release threads and memory."""
        for engine in self._engines.values():
            engine.close()
        self._is_closed = True

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _check_open(self, method: str) -> None:
        if self._is_closed:
            raise RuntimeError(f"{method} cannot be called after close")

    # Pictures.

    def _make_camera(self) -> MatrixCamera:
        """Return the camera of pictures drawn upside down."""
        return flip_rows(self._scene.make_camera((self._width, self._height)))

    def _draw_colors(self, camera: MatrixCamera, out: NDArray[Any]) -> None:
        """Draw colours; as in OpenGL, the computed light is the code."""
        sky = self._draw_sky(camera) if self._has_sky() else None
        if not self._scene.nodes:
            if sky is None:
                self._write_empty(out)
            else:
                self._write_picture(sky, out)
            return
        mirror = self._scene.find_mirror()
        frame = self._engines["linear"].render(
            self._scene, camera, outputs=("linear",) if mirror is None else ("linear", "object_id"),
            background="black" if sky is None else sky,
        )  # fmt: skip
        light = frame.linear[..., :3]
        if mirror is not None:
            self._add_reflection(camera, mirror, frame.object_id, light)
        self._write_picture(light, out)

    def _add_reflection(
        self, camera: MatrixCamera, mirror: tuple[int, Any, Any], object_id: NDArray[np.int32],
        light: NDArray[np.float32],
    ) -> None:  # fmt: skip
        """Add the light of the mirrored scene, times the reflectance, to the mirror's pixels."""
        mirror_geom, point, normal = mirror
        geom_numbers = self._scene.geom_numbers
        is_mirror = np.append(geom_numbers == mirror_geom, False)[object_id]
        scene, nodes = self._mirrored_scene, self._scene.nodes
        scene.nodes[:] = [node for n, node in enumerate(nodes) if geom_numbers[n] != mirror_geom]
        if not (scene.nodes and is_mirror.any()):
            return
        scene.lights[:] = [
            one if isinstance(one, AmbientLight) else replace(one, shadow=None)
            for one in self._scene.lights
        ]
        reflection, flip_x = np.eye(4), np.diag([-1.0, 1.0, 1.0, 1.0])
        reflection[:3, :3] -= 2.0 * np.outer(normal, normal)
        reflection[:3, 3] = 2.0 * (point @ normal) * normal
        view = flip_x @ camera.view_from_world @ reflection
        clip = camera.clip_from_view @ flip_x
        view[3] = 0.0, 0.0, 0.0, 1.0
        frame = self._engines["mirrored"].render(
            scene, make_matrix_camera(view, clip), outputs=("linear",), background="black"
        )
        # In place: selecting the pixels takes four times as long.
        mirrored = frame.linear[..., :3]
        reflectance = np.float32(self.scene.geoms[mirror_geom].reflectance)
        np.minimum(mirrored, np.float32(1.0), out=mirrored)
        mirrored *= (reflectance * is_mirror)[..., None]
        light += mirrored

    def _draw_shapes(self, camera: MatrixCamera, out: NDArray[Any]) -> None:
        """Draw depth or numbers at the centres of pixels."""
        scene = self._get_numbered_scene()
        if not scene.nodes:
            self._write_empty(out)
            return
        frame = self._engines[self._mode].render(scene, camera, outputs=(self._mode,))
        self._write_picture(frame.arrays()[self._mode], out)

    def _write_picture(self, drawn: NDArray[Any], out: NDArray[Any]) -> None:
        """Write a picture drawn upside down as MuJoCo returns it."""
        drawn = drawn[::-1]
        if self._mode == "depth":
            np.minimum(drawn, self._far_depth, out=out, casting="unsafe")
        elif self._mode == "object_id":
            out[:] = self._numbers.take(drawn, axis=0, mode="wrap")
        else:
            codes = drawn[..., :3] * np.float32(255.0)
            codes += np.float32(0.5)
            np.copyto(out, np.minimum(codes, np.float32(255.0), out=codes), casting="unsafe")

    def _write_empty(self, out: NDArray[Any]) -> None:
        """Write the picture of a scene without geoms."""
        out[:] = {"linear": 0, "object_id": -1, "depth": self._far_depth}[self._mode]

    @property
    def _far_depth(self) -> np.float32:
        """Depth of empty pixels: that of the far plane."""
        return np.float32(self.model.vis.map.zfar * self.model.stat.extent)

    def _has_sky_or_mirror(self) -> bool:
        return self._has_sky() or self._scene.find_mirror() is not None

    def _get_numbered_scene(self) -> Scene:
        """Return the scene of geoms with objects, and set ``_numbers`` to these."""
        scene = self._scene
        if self._numbered_rows is scene._geom_rows:
            return self._numbered_scene
        self._numbered_rows, objects = scene._geom_rows, scene.list_objects()
        parts = [n for n, row in enumerate(objects) if row is not None]
        self._numbered_scene.nodes[:] = [scene.nodes[n] for n in parts]
        # Empty pixels have index -1: the last row.
        self._numbers = np.array([*(objects[n] for n in parts), (-1, -1)], np.int32)
        return self._numbered_scene

    # The sky.

    def _has_sky(self) -> bool:
        return self._sky is not None and bool(self.scene.flags[FLAG.mjRND_SKYBOX])

    def _draw_sky(self, camera: MatrixCamera) -> NDArray[np.float32]:
        """Return the picture of the sky, (H, W, 3) linear, drawn upside down."""
        eye = camera.eye_position()
        plane = self._find_haze_plane(eye) if self.scene.flags[FLAG.mjRND_HAZE] else None
        key = camera, None if plane is None else plane.tobytes()
        if self._sky_picture is None or self._sky_picture[0] != key:
            radius = SKY_DISTANCE_SHARE * float(self.scene.camera[0].frustum_far)
            scene, sky_pose = Scene(), np.diag([radius, radius, radius, 1.0])
            sky_pose[:3, 3] = eye
            scene.add(self._sky, sky_pose)
            if plane is not None:
                haze_pose, height = np.eye(4), float((eye - plane[3]) @ plane[2])
                haze_pose[:3, :3] = plane[:3].T * (radius, radius, height)
                haze_pose[:3, 3] = eye - height * plane[2]
                scene.add(_make_haze(self.model), haze_pose)
            frame = self._engines["sky"].render(scene, camera, outputs=("linear",))
            self._sky_picture = key, np.ascontiguousarray(np.clip(frame.linear[..., :3], 0.0, 1.0))
        return self._sky_picture[1]

    def _find_haze_plane(self, eye: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return axes and position, (4, 3), of the first infinite plane; None if above the eye."""
        for geom in self.scene.geoms[: self.scene.ngeom]:
            if geom.type == GEOM.mjGEOM_PLANE and geom.size[0] == geom.size[1] == 0.0:
                plane = np.concatenate([geom.mat.T, geom.pos[None]]).astype(np.float64)
                return plane if (eye - plane[3]) @ plane[2] > 0.0 else None
        return None


def from_model(model: Any, max_geom: int = 10000) -> ModelScene:
    """
    Return a scene of a model, for `rasterjit.render` and all else that takes scenes.

    Colours are decoded, so that pictures of the output ``"color"`` look as MuJoCo's; light is
    computed linearly.

    Parameters
    ----------
    model : mujoco.MjModel
    max_geom : int
        Capacity of MuJoCo's list of geoms.

    Returns
    -------
    ModelScene
        In the model's initial state; ``follow(data)`` moves its nodes.
    """
    if not isinstance(model, mujoco.MjModel):
        raise ValueError(f"model must be a mujoco.MjModel, got {brief(model)}")
    scene = ModelScene(model, whole_number("max_geom", max_geom, 1, 1 << 24))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene.follow(data)
    scene.up = (0.0, 0.0, 1.0)
    return scene


def _make_sky(model: Any) -> Mesh | None:
    """Return a mesh of the first skybox of a model; None without any."""
    numbers = np.flatnonzero(np.asarray(model.tex_type) == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    if not len(numbers):
        return None
    texture = Texture(get_texture_picture(model, int(numbers[0])), color_space="linear")
    surface = shapes.make_sky()
    material = Material("unlit", base_color_texture=texture)
    return Mesh(surface.positions, surface.faces, uv=surface.uv, material=material)


def _make_haze(model: Any) -> Mesh:
    """Return a mesh of the haze of a model above the horizon."""
    surface, alpha = shapes.make_haze(float(model.vis.map.haze), int(model.vis.quality.numslices))
    color = np.clip(model.vis.rgba.haze[:3], 0.0, 1.0)
    colors = np.concatenate([np.tile(color, (len(alpha), 1)), alpha[:, None]], axis=1)
    material = Material("unlit", alpha_mode="blend")
    return Mesh(surface.positions, surface.faces, colors=colors, material=material)
