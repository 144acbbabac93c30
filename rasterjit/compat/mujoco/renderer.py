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
from rasterjit.compat.mujoco.drawing import (
    FLAG,
    GEOM,
    SHADOW_SIZE,
    ModelScene,
    check_state,
    picture_of,
)
from rasterjit.compat.opengl_camera import matrix_camera, upside_down
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

SAMPLES: tuple[Literal[1, 2, 4, 8, 16], ...] = (1, 2, 4, 8, 16)
"""How many samples a pixel may have."""

SHADOW_TEXELS = 4
"""Of a shadow map's side, for a pixel of the picture's longer one."""

SMALL = 1 << 16
"""Pixels of a picture up to which threads do not pay."""

SKY_DISTANCE = 0.7
"""Of the sky, in those of the far plane."""

PIXELS: dict[Mode, tuple[tuple[int, ...], type]] = {
    "linear": ((3,), np.uint8), "depth": ((), np.float32), "object_id": ((2,), np.int32),
}  # fmt: skip
"""What is drawn for colours, depth and numbers: the shape of a pixel, and its type."""


class Renderer:
    """
    Renders a model's scenes of one size: `mujoco.Renderer` without OpenGL.

    Parameters
    ----------
    model : mujoco.MjModel
    height, width : int, pixels
        At most the model's ``vis.global_.offheight`` and ``offwidth``, as in MuJoCo.
    max_geom : int
        Most geoms of a scene.
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
        room = model.vis.global_
        for name, value, most in (
            ("height", height, room.offheight),
            ("width", width, room.offwidth),
        ):
            if whole_number(name, value, 1, 16384) > most:
                raise ValueError(
                    f"{name} must be at most {most}, which the model sets by "
                    f'<visual><global off{name}="{most}"/></visual>, got {value}'
                )
        self._height, self._width = int(height), int(width)
        self._scene = ModelScene(model, whole_number("max_geom", max_geom, 1, 1 << 24), True)
        samples = max(s for s in SAMPLES if s <= max(1, model.vis.quality.offsamples))
        self._qualities = {
            "linear": Quality(samples=samples), "depth": Quality(subpixel_bits=12),
            # Mesa rounds vertices so.
            "object_id": Quality(subpixel_bits=8),
        }  # fmt: skip
        size = self._width, self._height
        self._scene._shadow_size = min(SHADOW_SIZE, SHADOW_TEXELS * max(size))
        self._threads = threads
        if threads is None and size[0] * size[1] <= SMALL:
            threads = 1
        self._engines = {
            name: Engine(size, quality=quality, threads=threads)
            for name, quality in {
                **self._qualities, "mirrored": self._qualities["linear"], "sky": Quality()
            }.items()
        }  # fmt: skip
        for engine in self._engines.values():
            engine.warned = None
        self._sky = _sky_of(model)
        self._sky_seen: tuple[Any, NDArray[np.float32]] | None = None
        self._mirrored, self._shapes = Scene(), Scene()
        self._numbered: Any = None
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
        """Let `render` return depth."""
        self._mode = "depth"

    def disable_depth_rendering(self) -> None:
        """Let `render` return colours again."""
        self._mode = "linear" if self._mode == "depth" else self._mode

    def enable_segmentation_rendering(self) -> None:
        """Let `render` return numbers and types of objects."""
        self._mode = "object_id"

    def disable_segmentation_rendering(self) -> None:
        """Let `render` return colours again."""
        self._mode = "linear" if self._mode == "object_id" else self._mode

    def update_scene(self, data: Any, camera: Any = -1, scene_option: Any = None) -> None:
        """
        Take over a state of the simulation.

        Parameters
        ----------
        data : mujoco.MjData
        camera : int, str or mujoco.MjvCamera
            By number or name; -1 is the free camera.
        scene_option : mujoco.MjvOption, optional
            What is shown.

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
            Where it is written, of the shape and type that are returned.

        Returns
        -------
        (H, W, 3) uint8, or
        (H, W) float32
            With depth rendering: along the viewing axis, in units of the model; where nothing is,
            that of the far plane.
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
        own, kind = PIXELS[self._mode]
        shape = self._height, self._width, *own
        found = np.empty(shape, kind) if out is None else out
        if not isinstance(found, np.ndarray) or (found.shape, found.dtype) != (shape, kind):
            expected = f"an array of {np.dtype(kind)} with shape {shape}"
            raise ValueError(f"out must be {expected}, got {brief(found)}")
        if not found.flags.writeable:
            raise ValueError("out must be writable, got an array that is read-only")
        # Programs add geoms to the list after update_scene.
        self._scene.update()
        if self._mode == "linear":
            self._draw_colors(self._camera(), found)
        else:
            self._draw_shapes(self._camera(), found)
        return found

    def render_batch(
        self, states: Iterable[Any], camera: Any = -1, scene_option: Any = None
    ) -> NDArray[Any]:
        """
        Render many states of the simulation, such as those of as many environments, in one call.

        Returns
        -------
        (N, ...) array
            What `render` returns of each.

        Raises
        ------
        RuntimeError
            After `close`.
        ValueError
            If MuJoCo lists other geoms for one of them than for the first, or an argument is wrong
            as it is for `update_scene`.
        """
        self._check_open("render_batch")
        given, own, kind = sequence("states", states), *PIXELS[self._mode]
        shape = len(given), self._height, self._width, *own
        found: NDArray[Any] = np.empty(shape, kind)
        if not given:
            return found
        places, cameras, lights = [], [], []
        known: Any = None
        has_extras = False
        for number, data in enumerate(given):
            scene = self._scene
            check_state(f"states[{number}]", data, self.model)
            scene.follow(data, camera, scene_option)
            if known is None:
                known = scene.listed
            elif scene.listed != known:
                raise ValueError(
                    "states must have the same geoms in the same colours, got others in "
                    f"states[{number}]"
                )
            places.append(scene.matrices)
            cameras.append(self._camera())
            lights.append(list(scene.lights))
            has_extras = has_extras or self._has_extras()
        drawn = self._shape_scene() if self._mode != "linear" else self._scene
        is_lit_apart = has_extras or lights != lights[:1] * len(lights)
        if self._scene.has_deformed or (self._mode == "linear" and is_lit_apart):
            # Each has skins, a sky or a mirror, or light, of its own.
            for number, data in enumerate(given):
                self.update_scene(data, camera, scene_option)
                self.render(out=found[number])
        elif not drawn.nodes:
            for number in range(len(given)):
                self._write_nothing(found[number])
        else:
            where = {id(node): n for n, node in enumerate(self._scene.nodes)}
            picked = [where[id(node)] for node in drawn.nodes]
            # `render` does not warn of empty views either.
            with silence_warnings(REPEATED):
                batch = render_batch(
                    drawn, cameras, size=(self._width, self._height), outputs=(self._mode,),
                    quality=self._qualities[self._mode], background="black",
                    transforms=np.stack(places)[:, picked], threads=self._threads,
                )  # fmt: skip
            for number in range(len(given)):
                self._write(batch.arrays()[self._mode][number], found[number])
        return found

    def close(self) -> None:
        """Let threads and memory go."""
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

    def _camera(self) -> MatrixCamera:
        """Return the camera, by which pictures are upside down."""
        return upside_down(self._scene.camera_for((self._width, self._height)))

    def _draw_colors(self, camera: MatrixCamera, out: NDArray[Any]) -> None:
        """Draw colours, the codes of which are the light that OpenGL computes."""
        behind = self._draw_sky(camera) if self._has_sky() else None
        if not self._scene.nodes:
            if behind is None:
                self._write_nothing(out)
            else:
                self._write(behind, out)
            return
        mirror = self._scene.mirror()
        frame = self._engines["linear"].render(
            self._scene, camera, outputs=("linear",) if mirror is None else ("linear", "object_id"),
            background="black" if behind is None else behind,
        )  # fmt: skip
        light = frame.linear[..., :3]
        if mirror is not None:
            self._add_mirrored(camera, mirror, frame.object_id, light)
        self._write(light, out)

    def _add_mirrored(
        self, camera: MatrixCamera, mirror: tuple[int, Any, Any], seen: NDArray[np.int32],
        light: NDArray[np.float32],
    ) -> None:  # fmt: skip
        """Add what a plane mirrors to the light of pixels that show it, as far as it does."""
        geom, point, normal = mirror
        owners = self._scene.geom_numbers
        where = np.append(owners == geom, False)[seen]
        scene, nodes = self._mirrored, self._scene.nodes
        scene.nodes[:] = [node for n, node in enumerate(nodes) if owners[n] != geom]
        if not (scene.nodes and where.any()):
            return
        scene.lights[:] = [
            one if isinstance(one, AmbientLight) else replace(one, shadow=None)
            for one in self._scene.lights
        ]
        turn, flip = np.eye(4), np.diag([-1.0, 1.0, 1.0, 1.0])
        turn[:3, :3] -= 2.0 * np.outer(normal, normal)
        turn[:3, 3] = 2.0 * (point @ normal) * normal
        view, clip = flip @ camera.view_from_world @ turn, camera.clip_from_view @ flip
        view[3] = 0.0, 0.0, 0.0, 1.0
        frame = self._engines["mirrored"].render(
            scene, matrix_camera(view, clip), outputs=("linear",), background="black"
        )
        # In place: picking the pixels takes four times as long.
        mirrored, share = frame.linear[..., :3], np.float32(self.scene.geoms[geom].reflectance)
        np.minimum(mirrored, np.float32(1.0), out=mirrored)
        mirrored *= (share * where)[..., None]
        light += mirrored

    def _draw_shapes(self, camera: MatrixCamera, out: NDArray[Any]) -> None:
        """Draw depth or numbers at the centres of pixels."""
        scene = self._shape_scene()
        if not scene.nodes:
            self._write_nothing(out)
            return
        frame = self._engines[self._mode].render(scene, camera, outputs=(self._mode,))
        self._write(frame.arrays()[self._mode], out)

    def _write(self, drawn: NDArray[Any], out: NDArray[Any]) -> None:
        """Write what was drawn upside down as MuJoCo returns it."""
        drawn = drawn[::-1]
        if self._mode == "depth":
            np.minimum(drawn, self._far, out=out, casting="unsafe")
        elif self._mode == "object_id":
            out[:] = self._numbers.take(drawn, axis=0, mode="wrap")
        else:
            codes = drawn[..., :3] * np.float32(255.0)
            codes += np.float32(0.5)
            np.copyto(out, np.minimum(codes, np.float32(255.0), out=codes), casting="unsafe")

    def _write_nothing(self, out: NDArray[Any]) -> None:
        """Write what a scene without geoms looks like."""
        out[:] = {"linear": 0, "object_id": -1, "depth": self._far}[self._mode]

    @property
    def _far(self) -> np.float32:
        """Depth where nothing is."""
        return np.float32(self.model.vis.map.zfar * self.model.stat.extent)

    def _has_extras(self) -> bool:
        return self._has_sky() or self._scene.mirror() is not None

    def _shape_scene(self) -> Scene:
        """Return the scene of geoms that have numbers, and find these."""
        scene = self._scene
        if self._numbered is scene._lists:
            return self._shapes
        self._numbered, numbers = scene._lists, scene.object_numbers()
        parts = [n for n, row in enumerate(numbers) if row is not None]
        self._shapes.nodes[:] = [scene.nodes[n] for n in parts]
        # Nothing has number -1: the last row.
        self._numbers = np.array([*(numbers[n] for n in parts), (-1, -1)], np.int32)
        return self._shapes

    # The sky.

    def _has_sky(self) -> bool:
        return self._sky is not None and bool(self.scene.flags[FLAG.mjRND_SKYBOX])

    def _draw_sky(self, camera: MatrixCamera) -> NDArray[np.float32]:
        """Return the sky that a camera sees, (H, W, 3) linear, drawn upside down."""
        eye = camera.eye_position()
        plane = self._haze_plane(eye) if self.scene.flags[FLAG.mjRND_HAZE] else None
        key = camera, None if plane is None else plane.tobytes()
        if self._sky_seen is None or self._sky_seen[0] != key:
            scene, far = Scene(), SKY_DISTANCE * float(self.scene.camera[0].frustum_far)
            place = np.diag([far, far, far, 1.0])
            place[:3, 3] = eye
            scene.add(self._sky, place)
            if plane is not None:
                around, height = np.eye(4), float((eye - plane[3]) @ plane[2])
                around[:3, :3] = plane[:3].T * (far, far, height)
                around[:3, 3] = eye - height * plane[2]
                scene.add(_haze_of(self.model), around)
            frame = self._engines["sky"].render(scene, camera, outputs=("linear",))
            self._sky_seen = key, np.ascontiguousarray(np.clip(frame.linear[..., :3], 0.0, 1.0))
        return self._sky_seen[1]

    def _haze_plane(self, eye: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return axes and position, (4, 3), of the first infinite plane, if it is below the eye."""
        for geom in self.scene.geoms[: self.scene.ngeom]:
            if geom.type == GEOM.mjGEOM_PLANE and geom.size[0] == geom.size[1] == 0.0:
                found = np.concatenate([geom.mat.T, geom.pos[None]]).astype(np.float64)
                return found if (eye - found[3]) @ found[2] > 0.0 else None
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
        Most geoms of it.

    Returns
    -------
    ModelScene
        As the model stands at first; ``follow(data)`` moves its nodes.
    """
    if not isinstance(model, mujoco.MjModel):
        raise ValueError(f"model must be a mujoco.MjModel, got {brief(model)}")
    scene, data = (
        ModelScene(model, whole_number("max_geom", max_geom, 1, 1 << 24)),
        mujoco.MjData(model),
    )
    mujoco.mj_forward(model, data)
    scene.follow(data)
    scene.up = (0.0, 0.0, 1.0)
    return scene


def _sky_of(model: Any) -> Mesh | None:
    """Return the first skybox of a model, None without any."""
    numbers = np.flatnonzero(np.asarray(model.tex_type) == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    if not len(numbers):
        return None
    texture = Texture(picture_of(model, int(numbers[0])), color_space="linear")
    surface = shapes.sky()
    material = Material("unlit", base_color_texture=texture)
    return Mesh(surface.positions, surface.faces, uv=surface.uv, material=material)


def _haze_of(model: Any) -> Mesh:
    """Return the haze of a model above the horizon."""
    surface, alpha = shapes.haze(float(model.vis.map.haze), int(model.vis.quality.numslices))
    color = np.clip(model.vis.rgba.haze[:3], 0.0, 1.0)
    colors = np.concatenate([np.tile(color, (len(alpha), 1)), alpha[:, None]], axis=1)
    material = Material("unlit", alpha_mode="blend")
    return Mesh(surface.positions, surface.faces, colors=colors, material=material)
