"""
Vulkan on a CPU: Mesa's lavapipe through wgpu, whose wheel brings the rest.

Needs ``apt-get install mesa-vulkan-drivers``. lavapipe rasterizes with llvmpipe's code; what
differs from OpenGL is the driver above it. Colours are written to a linear RGBA8 target; a scene
without colours is drawn in one. Waiting for the picture is waiting for its copy in a buffer that
can be mapped, so this copy counts as drawing; reading copies from there into one NumPy array.
Threads as for llvmpipe, beside the one that lavapipe always keeps for its queue.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared, opengl
from benchmarks.contestants.needs import EDGE_COLOR, needs, refusal
from benchmarks.contestants.screen import find_unique_edges, matrices
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "Mesa lavapipe (wgpu)"

DRIVER = "llvmpipe"
"""What lavapipe calls its device."""

SHADER = """
struct Uniforms {{
    clip_from_world: mat4x4f,
    to_light: vec3f,
    ambient: f32,
    eye: vec3f,
    specular: f32,
    one_color: vec4f,
    shininess: f32,
}}
@group(0) @binding(0) var<uniform> u: Uniforms;

struct Varying {{
    @builtin(position) position: vec4f,
    @location(0) color: vec4f,
    @location(1) normal: vec3f,
    @location(2) world: vec3f,
}}

@vertex
fn vertex(@location(0) position: vec3f {inputs}) -> Varying {{
    let placed = {placed} * vec4f(position, 1.0);
    var out: Varying;
    out.position = u.clip_from_world * placed;
    out.position.z = 0.5 * (out.position.z + out.position.w);
    out.color = {color};
    out.normal = {normal};
    out.world = placed.xyz;
    return out;
}}

@fragment
fn smooth_color(v: Varying) -> @location(0) vec4f {{ return v.color; }}

@fragment
fn lit(v: Varying, @builtin(front_facing) is_front: bool) -> @location(0) vec4f {{
    let normal = normalize(select(-v.normal, v.normal, is_front));
    let facing = max(dot(normal, u.to_light), 0.0);
    let middle = normalize(u.to_light + normalize(u.eye - v.world));
    let shine = select(0.0, u.specular * pow(max(dot(normal, middle), 0.0), u.shininess),
                       facing > 0.0);
    return vec4f(v.color.rgb * (u.ambient + facing) + shine, 1.0);
}}
"""

IDENTITY = "mat4x4f(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)"

ROW_ALIGNMENT = 256
"""WebGPU wants rows of a picture in a buffer to start at multiples of it, bytes."""

COLOR_FORMAT, DEPTH_FORMAT = "rgba8unorm", "depth32float"


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("wgpu") is None:
        return 'the package wgpu is not installed (pip install ".[bench]")'
    try:
        open_adapter()
    except Exception as error:  # whatever the loader or the driver raises
        return f"no Vulkan on a CPU (apt-get install mesa-vulkan-drivers): {error}"
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {"LP_NUM_THREADS": "0" if threads == 1 else str(threads)}


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refusal(scene, {})


def alike(scene: Scene) -> tuple[float, float]:
    """Return the shares of pixels alike that its rules allow for: its lines are a little wider."""
    return (0.985, 0.8) if isinstance(scene, LineScene) else opengl.alike(scene)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    return Pictures(scene)


def open_adapter() -> Any:
    """Return lavapipe; without it raise ``RuntimeError``."""
    import wgpu

    os.environ.setdefault("XDG_RUNTIME_DIR", os.getcwd())  # unset, Mesa complains
    for adapter in wgpu.gpu.enumerate_adapters_sync():
        if adapter.info["backend_type"] == "Vulkan" and DRIVER in adapter.info["device"]:
            return adapter
    raise RuntimeError("no adapter is lavapipe")


def version() -> str | None:
    """Return what the driver calls itself, or ``None`` if there is none."""
    if available() is not None:
        return None
    info = open_adapter().info
    return f"{info['device']}, {info['description']}"


class Pictures:
    """A pipeline, its buffers, and a picture off screen."""

    def __init__(self, scene: Scene) -> None:
        self._device = open_adapter().request_device_sync()
        self._size = scene.size
        self._tests_depth = not isinstance(scene, LineScene) and scene.mode == "fill"
        if isinstance(scene, LineScene):
            self._upload_lines(scene)
        else:
            self._upload_triangles(scene)
        self._make_targets()
        self._make_pipeline(scene)

    def _upload(self, data: NDArray[Any], usage: str) -> Any:
        """Return a buffer with the data in it."""
        return self._device.create_buffer_with_data(
            data=np.ascontiguousarray(data).tobytes(), usage=usage
        )

    def _upload_lines(self, scene: LineScene) -> None:
        """Upload the ends of lines in clip space, through pixel centres."""
        pixels = (scene.ends.reshape(-1, 2) + 0.5) / scene.size * 2.0 - 1.0
        positions = np.column_stack([pixels * (1.0, -1.0), np.zeros(len(pixels))])
        self._streams = [
            (positions.astype(np.float32), "float32x3", "vertex"),
            (scene.colors.reshape(-1, 4), "unorm8x4", "vertex"),
        ]
        self._names = ["", "color: vec4f"]
        self._indices, self._count, self._instances = None, len(positions), 1
        self._uniforms = [uniforms(np.eye(4), None)]

    def _upload_triangles(self, scene: TriangleScene) -> None:
        """Upload the mesh, or its edges, and where its instances stand."""
        self._streams = [(scene.positions, "float32x3", "vertex")]
        self._names = [""]
        if scene.colors is not None:
            self._streams.append((scene.colors, "unorm8x4", "vertex"))
            self._names.append("color: vec4f")
        if scene.normals is not None:
            self._streams.append((scene.normals, "float32x3", "vertex"))
            self._names.append("normal: vec3f")
        if scene.instances is not None:
            for column in range(4):
                columns = scene.instances[:, :, column].astype(np.float32)
                self._streams.append((columns, "float32x4", "instance"))
                self._names.append(f"column{column}: vec4f")
        self._instances = 1 if scene.instances is None else len(scene.instances)
        indices = scene.faces if scene.mode == "fill" else find_unique_edges(scene.faces)
        self._indices, self._count = self._upload(indices, "INDEX"), indices.size
        self._uniforms = [uniforms(matrix, scene) for matrix in matrices(scene)]

    def _make_targets(self) -> None:
        """Make the picture, its depth buffer if any, and the way back to NumPy."""
        width, height = self._size
        size = (width, height, 1)
        self._texture = self._device.create_texture(
            size=size, format=COLOR_FORMAT, usage="RENDER_ATTACHMENT|COPY_SRC"
        )
        self._depth = None
        if self._tests_depth:
            self._depth = self._device.create_texture(
                size=size, format=DEPTH_FORMAT, usage="RENDER_ATTACHMENT"
            )
        self._row_bytes = -(-4 * width // ROW_ALIGNMENT) * ROW_ALIGNMENT
        self._staging = self._device.create_buffer(
            size=self._row_bytes * height, usage="MAP_READ|COPY_DST"
        )
        self._pixels = np.empty((height, width, 4), np.uint8)

    def _make_pipeline(self, scene: Scene) -> None:
        """Compile the shaders and bind the buffers."""
        inputs = "".join(
            f", @location({place}) {name}" for place, name in enumerate(self._names) if name
        )
        is_lit = not isinstance(scene, LineScene) and "lighting" in needs(scene)
        is_placed = self._instances > 1
        shader = SHADER.format(
            inputs=inputs,
            placed="mat4x4f(column0, column1, column2, column3)" if is_placed else IDENTITY,
            color="color" if "color: vec4f" in self._names else "u.one_color",
            normal="normal" if is_lit else "vec3f(0.0)",
        )
        module = self._device.create_shader_module(code=shader)
        is_lines = isinstance(scene, LineScene) or scene.mode == "edges"
        cull = "none" if isinstance(scene, LineScene) else scene.cull
        self._pipeline = self._device.create_render_pipeline(
            layout="auto",
            vertex={
                "module": module,
                "entry_point": "vertex",
                "buffers": [
                    {
                        "array_stride": data.strides[0] if data.ndim > 1 else data.itemsize,
                        "step_mode": step,
                        "attributes": [{"format": form, "offset": 0, "shader_location": place}],
                    }
                    for place, (data, form, step) in enumerate(self._streams)
                ],
            },
            primitive={
                "topology": "line-list" if is_lines else "triangle-list",
                "front_face": "ccw",
                "cull_mode": cull,
            },
            depth_stencil=(
                {"format": DEPTH_FORMAT, "depth_write_enabled": True, "depth_compare": "less"}
                if self._tests_depth
                else None
            ),
            fragment={
                "module": module,
                "entry_point": "lit" if is_lit else "smooth_color",
                "targets": [{"format": COLOR_FORMAT}],
            },
        )
        self._vertex_buffers = [self._upload(data, "VERTEX") for data, _, _ in self._streams]
        self._uniform_buffer = self._upload(self._uniforms[0], "UNIFORM|COPY_DST")
        self._bindings = self._device.create_bind_group(
            layout=self._pipeline.get_bind_group_layout(0),
            entries=[{"binding": 0, "resource": {"buffer": self._uniform_buffer}}],
        )

    def draw(self) -> None:
        """Clear, draw, and wait until the picture is in memory; all views, each read back."""
        for values in self._uniforms:
            self._draw_one(values)
            if len(self._uniforms) > 1:
                self.read()

    def _draw_one(self, values: NDArray[np.float32]) -> None:
        """Draw one picture."""
        if self._staging.map_state != "unmapped":
            self._staging.unmap()
        queue = self._device.queue
        queue.write_buffer(self._uniform_buffer, 0, values)
        encoder = self._device.create_command_encoder()
        depth = None
        if self._depth is not None:
            depth = {
                "view": self._depth.create_view(),
                "depth_clear_value": 1.0,
                "depth_load_op": "clear",
                "depth_store_op": "discard",
            }
        drawing = encoder.begin_render_pass(
            color_attachments=[
                {
                    "view": self._texture.create_view(),
                    "load_op": "clear",
                    "store_op": "store",
                    "clear_value": (0.0, 0.0, 0.0, 0.0),
                }
            ],
            depth_stencil_attachment=depth,
        )
        drawing.set_pipeline(self._pipeline)
        drawing.set_bind_group(0, self._bindings)
        for slot, buffer in enumerate(self._vertex_buffers):
            drawing.set_vertex_buffer(slot, buffer)
        if self._indices is None:
            drawing.draw(self._count, self._instances)
        else:
            drawing.set_index_buffer(self._indices, "uint32")
            drawing.draw_indexed(self._count, self._instances)
        drawing.end()
        width, height = self._size
        encoder.copy_texture_to_buffer(
            {"texture": self._texture},
            {"buffer": self._staging, "bytes_per_row": self._row_bytes, "rows_per_image": height},
            (width, height, 1),
        )
        queue.submit([encoder.finish()])
        self._staging.map_sync("READ")

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture, top row first, in the same array every time."""
        height, width, _ = self._pixels.shape
        mapped = np.frombuffer(self._staging.read_mapped(copy=False), np.uint8)
        rows = mapped.reshape(height, self._row_bytes)[:, : 4 * width]
        np.copyto(self._pixels.reshape(height, 4 * width), rows)
        return {"color": self._pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        color = self.read()["color"]
        return {"covered": color[:, :, 3] > 0, "color_linear": color[:, :, :3].copy()}


def uniforms(clip_from_world: NDArray[np.float64], scene: TriangleScene | None) -> NDArray[Any]:
    """Return the shader's uniforms, (32,) float32, padded as WGSL lays them out."""
    values = np.zeros(32, np.float32)
    values[:16] = clip_from_world.T.ravel()
    values[24:28] = np.array(EDGE_COLOR) / 255
    if scene is not None and scene.to_light is not None:
        values[16:19], values[19] = scene.to_light, scene.ambient
        values[20:23], values[23] = scene.eye, scene.specular
        values[28] = scene.shininess
    return values
