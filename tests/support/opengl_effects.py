"""
Draw effects with real OpenGL, off screen: shaders written for the tests, run by Mesa's llvmpipe.

Light is summed in linear light and left in float32, so that pictures are compared before anything
is rounded to 8 bits. Clip positions are computed in float64 and given to OpenGL as float32; y is
negated there, as in ``opengl``, so that both sides rasterize the same geometry in the same rows.

A fragment shader is put together from the parts below. Each test's own part is one function,
``vec4 shade()``: linear red, green and blue, and alpha.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from opengl import require_opengl

import rasterjit as rj

VERTEX = """
#version 400
in vec4 clip_position;
in vec3 position;
in vec3 normal;
in vec2 uv;
in vec4 color;
out vec3 world;
out vec3 smooth_normal;
out vec2 place;
out vec4 tint;
void main() {
    gl_Position = vec4(clip_position.x, -clip_position.y, clip_position.zw);
    world = position;
    smooth_normal = normal;
    place = uv;
    tint = color;
}
"""

BEGIN = """
#version 400
uniform vec3 eye;
uniform int first_face;
in vec3 world;
in vec3 smooth_normal;
in vec2 place;
in vec4 tint;
layout(location = 0) out vec4 seen;
layout(location = 1) out int face;

vec3 turned_normal() {
    return normalize(gl_FrontFacing ? smooth_normal : -smooth_normal);
}
"""

END = """
void main() {
    seen = shade();
    face = first_face + gl_PrimitiveID;
}
"""

LIGHTS = """
uniform vec3 ambient;
uniform int light_count;
uniform vec4 light_place[8];   // xyz - w p points from p to the light
uniform vec3 light_color[8];
uniform float light_range[8];  // infinite if there is none
uniform vec3 light_axis[8];    // where a spot light points
uniform vec2 light_cone[8];    // cosines of the inner and the outer angle; no spot light: -2

// KHR_lights_punctual: inverse square, a smooth end at the range, a smooth cone.
vec3 toward_light(int n, out vec3 arriving) {
    vec3 offset = light_place[n].xyz - light_place[n].w * world;
    float length_ = length(offset);
    vec3 direction = offset / length_;
    arriving = light_color[n];
    if (light_place[n].w > 0.0) {
        float share = length_ / light_range[n];
        float window = isinf(light_range[n]) ? 1.0 : clamp(1.0 - pow(share, 4.0), 0.0, 1.0);
        arriving *= window / (length_ * length_);
    }
    if (light_cone[n].x > -1.5) {
        float cosine = dot(light_axis[n], -direction);
        float width = max(light_cone[n].x - light_cone[n].y, 1e-6);
        float cone = clamp((cosine - light_cone[n].y) / width, 0.0, 1.0);
        arriving *= cone * cone;
    }
    return direction;
}
"""

BLINN_PHONG = """
uniform float specular;
uniform float shininess;

vec3 blinn_phong(vec3 base, vec3 normal, vec3 viewer, vec3 light, vec3 arriving) {
    float facing = max(dot(normal, light), 0.0);
    float cosine = max(dot(normal, normalize(light + viewer)), 0.0);
    float shine = facing > 0.0 ? specular * pow(cosine, shininess) : 0.0;
    return arriving * (base * facing + shine);
}
"""

METALLIC_ROUGHNESS = """
uniform float metallic;
uniform float roughness;
const float PI = 3.14159265358979;

// glTF 2.0, appendix B: a mix of a dielectric and a metal with facets spread by GGX. Smith's
// shadowing with correlated heights, as in Khronos' own viewer; the appendix has the separable
// form. Without the factor 1 / PI: light of intensity 1 makes a white surface white. Metals show as
// well what facets send on after several bounces: a share of the light that a fit tells.
float cubic(float x, vec4 c) { return dot(c, vec4(1.0, x, x * x, x * x * x)); }

vec3 bounced(vec3 base, float n_v) {
    float total = cubic(n_v, vec4(
        cubic(roughness, vec4(1.03258, -1.20292, 2.74047, -1.69267)),
        cubic(roughness, vec4(-0.0462228, 4.95571, -15.7929, 9.5428)),
        cubic(roughness, vec4(-0.13758, -4.45289, 18.0092, -12.2217)),
        cubic(roughness, vec4(0.126206, 1.18405, -6.3583, 4.58152))));
    float offset = cubic(n_v, vec4(
        cubic(roughness, vec4(1.01424, -2.06212, 0.775402, 0.347573)),
        cubic(roughness, vec4(-4.28602, 11.3499, -9.19793, 1.87035)),
        cubic(roughness, vec4(5.91556, -18.5306, 19.3117, -6.39416)),
        cubic(roughness, vec4(-2.66093, 9.34343, -11.0615, 4.26546))));
    total = clamp(total, 0.0, 1.0);
    offset = clamp(offset, 0.0, total);
    vec3 mean = base + (1.0 - base) / 21.0;
    vec3 held = (1.0 - total) * mean;
    return (base * (total - offset) + offset) * held / (1.0 - held);
}

vec3 metallic_roughness(vec3 base, vec3 normal, vec3 viewer, vec3 light, vec3 arriving) {
    vec3 half_way = normalize(light + viewer);
    float n_l = dot(normal, light);
    float n_v = max(dot(normal, viewer), 1e-4);
    float n_h = dot(normal, half_way);
    if (n_l <= 0.0) return vec3(0.0);
    float squared = pow(roughness, 4.0);
    float below = n_h * n_h * (squared - 1.0) + 1.0;
    float distribution = squared / (PI * below * below);
    float light_side = n_v * sqrt(n_l * n_l * (1.0 - squared) + squared);
    float viewer_side = n_l * sqrt(n_v * n_v * (1.0 - squared) + squared);
    float specular = distribution * 0.5 / (light_side + viewer_side);
    float grazing = pow(1.0 - abs(dot(viewer, half_way)), 5.0);
    vec3 metal = specular * (base + (1.0 - base) * grazing) + bounced(base, n_v) / PI;
    vec3 dielectric = mix(base / PI, vec3(specular), 0.04 + 0.96 * grazing);
    return PI * arriving * n_l * mix(dielectric, metal, metallic);
}
"""

FOG = """
uniform vec3 fog_color;
uniform int fog_mode;  // 0 linear, 1 exp, 2 exp2
uniform float fog_start;
uniform float fog_end;
uniform float fog_density;

// What is left of a colour at a distance, as OpenGL's fixed function had it.
float fog_share(float far) {
    if (fog_mode == 0) return clamp((fog_end - far) / (fog_end - fog_start), 0.0, 1.0);
    if (fog_mode == 1) return exp(-fog_density * far);
    return exp(-(fog_density * far) * (fog_density * far));
}
"""

LIT = """
uniform vec4 base_color;
vec4 shade() {
    vec3 normal = turned_normal();
    vec3 viewer = normalize(eye - world);
    vec4 base = base_color * tint;
    vec3 sum = ambient * base.rgb;
    for (int n = 0; n < light_count; ++n) {
        vec3 arriving;
        vec3 light = toward_light(n, arriving);
        sum += MODEL(base.rgb, normal, viewer, light, arriving);
    }
    return vec4(sum, base.a);
}
"""
"""Lit by all lights; ``MODEL`` stands for the reflection's name."""

SHADOW = """
uniform mat4 shadow_from_world;   // to 0..1 in all three axes
uniform sampler2DShadow shadow_map;
uniform float shadow_bias;        // of depth, 0..1

// Percentage-closer filtering: comparisons at (2 reach + 1) squared texels, each among four.
float lit_share(int reach) {
    vec4 at = shadow_from_world * vec4(world, 1.0);
    at.xyz /= at.w;
    vec2 step_ = 1.0 / vec2(textureSize(shadow_map, 0));
    float sum = 0.0;
    for (int down = -reach; down <= reach; ++down)
        for (int across = -reach; across <= reach; ++across)
            sum += texture(shadow_map, at.xyz + vec3(vec2(across, down) * step_, -shadow_bias));
    return sum / ((2.0 * reach + 1.0) * (2.0 * reach + 1.0));
}
"""

SKY = """
uniform sampler2D panorama;
const float TURN = 6.28318530717959;

// What is seen in a direction: +x in the middle of the picture, +z right of it, +y on top.
vec3 sky(vec3 direction) {
    float around = atan(direction.z, direction.x) / TURN;
    float up = asin(clamp(direction.y, -1.0, 1.0)) / (0.5 * TURN);
    return textureLod(panorama, vec2(around + 0.5, up + 0.5), 0.0).rgb;
}

mat3 axes_about(vec3 middle) {
    vec3 side = normalize(abs(middle.y) < 0.9 ? vec3(middle.z, 0.0, -middle.x)
                                              : vec3(0.0, -middle.z, middle.y));
    return mat3(side, cross(middle, side), middle);
}
"""

MATT_UNDER_SKY = """
uniform vec4 base_color;

// The mean of the sky, weighted by the cosine, over rings of directions of the same weight.
vec4 shade() {
    mat3 axes = axes_about(turned_normal());
    vec3 sum = vec3(0.0);
    for (int ring = 0; ring < 24; ++ring) {
        float squared = (ring + 0.5) / 24.0;
        for (int n = 0; n < 48; ++n) {
            float angle = TURN * (n + 0.5) / 48.0;
            vec2 across = sqrt(squared) * vec2(cos(angle), sin(angle));
            sum += sky(axes * vec3(across, sqrt(1.0 - squared)));
        }
    }
    return vec4(base_color.rgb * sum / (24.0 * 48.0), 1.0);
}
"""

WHITE_METAL_UNDER_SKY = """
uniform float roughness;

// The mean of the sky over what GGX facets mirror (Walter et al. 2007), each by its share. The
// shares are brought to a sum of 1: what facets send on after several bounces is white as well.
vec4 shade() {
    vec3 normal = turned_normal(), viewer = normalize(eye - world);
    if (roughness == 0.0) return vec4(sky(reflect(-viewer, normal)), 1.0);
    mat3 axes = axes_about(normal);
    float squared = pow(roughness, 4.0), n_v = max(dot(normal, viewer), 1e-4);
    vec3 sum = vec3(0.0);
    float shares = 0.0;
    for (int ring = 0; ring < 32; ++ring) {
        float u = (ring + 0.5) / 32.0;
        float cosine = sqrt((1.0 - u) / (1.0 + (squared - 1.0) * u));
        for (int n = 0; n < 32; ++n) {
            float angle = TURN * (n + 0.5) / 32.0;
            vec2 across = sqrt(1.0 - cosine * cosine) * vec2(cos(angle), sin(angle));
            vec3 facet = axes * vec3(across, cosine);
            vec3 light = reflect(-viewer, facet);
            float n_l = dot(normal, light), v_h = dot(viewer, facet);
            if (n_l <= 0.0 || v_h <= 0.0) continue;
            float lit_part = n_v * sqrt(n_l * n_l * (1.0 - squared) + squared);
            float seen_part = n_l * sqrt(n_v * n_v * (1.0 - squared) + squared);
            float share = n_l * v_h / (cosine * (lit_part + seen_part));
            sum += share * sky(light);
            shares += share;
        }
    }
    return vec4(sum / shares, 1.0);
}
"""

TONE_CURVES = """
uniform int curve;  // 0 none, 1 Reinhard, 2 ACES by Hill, 3 Khronos PBR Neutral
uniform float exposure;
uniform float white;

vec3 reinhard(vec3 color) {
    float luminance = dot(color, vec3(0.2126, 0.7152, 0.0722));
    return color * (1.0 + luminance / (white * white)) / (1.0 + luminance);
}

vec3 aces(vec3 color) {
    const mat3 into = mat3(0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383,
                           0.04823, 0.01566, 0.83777);
    const mat3 back = mat3(1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276,
                           -0.07367, -0.00605, 1.07602);
    vec3 v = into * color;
    vec3 above = v * (v + 0.0245786) - 0.000090537;
    return back * (above / (v * (0.983729 * v + 0.4329510) + 0.238081));
}

vec3 neutral(vec3 color) {
    const float start = 0.8 - 0.04;
    const float desaturation = 0.15;
    float least = min(color.r, min(color.g, color.b));
    float offset = least < 0.08 ? least - 6.25 * least * least : 0.04;
    color -= offset;
    float peak = max(color.r, max(color.g, color.b));
    if (peak < start) return color;
    float rest = 1.0 - start;
    float lowered = 1.0 - rest * rest / (peak + rest - start);
    color *= lowered / peak;
    float share = 1.0 - 1.0 / (desaturation * (peak - lowered) + 1.0);
    return mix(color, vec3(lowered), share);
}

vec3 encoded(vec3 linear) {
    vec3 held = clamp(linear, 0.0, 1.0);
    return mix(1.055 * pow(held, vec3(1.0 / 2.4)) - 0.055, 12.92 * held,
               lessThanEqual(held, vec3(0.0031308)));
}

vec3 shown(vec3 color) {
    color *= exp2(exposure);
    if (curve == 1) color = reinhard(color);
    if (curve == 2) color = aces(color);
    if (curve == 3) color = neutral(color);
    return encoded(color);
}
"""

PHONG_PARTS = (LIGHTS, BLINN_PHONG, LIT.replace("MODEL", "blinn_phong"))
MICROFACET_PARTS = (LIGHTS, METALLIC_ROUGHNESS, LIT.replace("MODEL", "metallic_roughness"))

NO_CONE = (-2.0, -2.0)


@dataclass
class Shape:
    """Triangles in world space, with what a shader may read of them."""

    positions: NDArray[np.float64]
    """(V, 3), world space."""
    faces: NDArray[np.int32]
    """(F, 3)"""
    normals: NDArray[np.float64] | None = None
    """(V, 3), unit."""
    uv: NDArray[np.float64] | None = None
    """(V, 2), v up."""
    colors: NDArray[np.float32] | None = None
    """(V, 4), linear."""
    uniforms: dict[str, Any] = field(default_factory=dict)
    """What differs from shape to shape."""

    def mesh(self, material: rj.Material) -> rj.Mesh:
        """Return the same for RasterJIT."""
        return rj.Mesh(
            self.positions, self.faces, normals=self.normals, uv=self.uv, colors=self.colors,
            material=material,
        )  # fmt: skip


class Seen(NamedTuple):
    """What OpenGL drew, row 0 on top."""

    linear: NDArray[np.float32]
    """(H, W, 4), 0 where nothing is."""
    face_id: NDArray[np.int32]
    """(H, W), -1 where nothing is; counted over all shapes."""


def clip_from_world(camera: Any, size: tuple[int, int]) -> NDArray[np.float64]:
    """Return the whole matrix of a camera, (4, 4)."""
    return camera.projection_matrix(size) @ camera.view_matrix()


def to_clip(matrix: NDArray[np.float64], positions: ArrayLike) -> NDArray[np.float64]:
    """Return points, (V, 3), in clip space, (V, 4)."""
    points = np.asarray(positions, np.float64)
    return points @ matrix[:, :3].T + matrix[:, 3]


@functools.cache
def compiled(parts: tuple[str, ...], vertex: str = VERTEX) -> Any:
    """Return the program of a fragment shader made of ``BEGIN``, these parts and ``END``."""
    return require_opengl().program(vertex, "\n".join([BEGIN, *parts, END]))


def set_uniforms(program: Any, values: Mapping[str, Any]) -> None:
    """Set those uniforms that the program has: the others were found to be of no use."""
    for name, value in values.items():
        if name not in program:
            continue
        uniform = program[name]
        kind = np.int32 if uniform.fmt.endswith("i") else np.float32
        values_ = np.zeros((uniform.array_length, uniform.dimension), kind)
        given = np.asarray(value, kind).reshape(-1, uniform.dimension)
        values_[: len(given)] = given
        uniform.write(values_.tobytes())


def light_uniforms(lights: Sequence[Any]) -> dict[str, Any]:
    """Return RasterJIT's lights as the shader's uniforms."""
    ambient = np.zeros(3)
    rows: list[tuple[Any, ...]] = []
    for light in lights:
        color = np.multiply(light.color, light.intensity)
        if isinstance(light, rj.AmbientLight):
            ambient += color
        elif isinstance(light, rj.DirectionalLight):
            place = (*np.negative(light.direction), 0.0)
            rows.append((place, color, np.inf, (0.0, 0.0, 0.0), NO_CONE))
        else:
            limit = np.inf if light.range is None else light.range
            axis, cone = (0.0, 0.0, 0.0), NO_CONE
            if isinstance(light, rj.SpotLight):
                axis = light.direction
                cone = tuple(np.cos(np.radians([light.inner_angle, light.outer_angle])))
            rows.append(((*light.position, 1.0), color, limit, axis, cone))
    names = ("light_place", "light_color", "light_range", "light_axis", "light_cone")
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return {
        "ambient": ambient,
        "light_count": len(rows),
        **dict(zip(names, columns, strict=False)),
    }


def material_uniforms(material: rj.Material) -> dict[str, Any]:
    """Return a material's numbers as the shader's uniforms."""
    names = ("base_color", "specular", "shininess", "metallic", "roughness")
    return {name: getattr(material, name) for name in names if hasattr(material, name)}


class Sheet:
    """
    A picture of floats off screen, with face numbers and a depth buffer.

    Parameters
    ----------
    size : (int, int)
        Width and height, pixels.
    samples : int
        Of each pixel; 0 draws at the pixel's centre.
    """

    def __init__(self, size: tuple[int, int], samples: int = 0) -> None:
        self.context = require_opengl()
        self.size, self.samples = size, samples
        self.color = self.context.texture(size, 4, dtype="f4", samples=samples)
        self.face = self.context.texture(size, 1, dtype="i4", samples=samples)
        self._depth = self.context.depth_renderbuffer(size, samples=samples)
        self._buffer = self.context.framebuffer([self.color, self.face], self._depth)
        self._faces = 0

    def begin(self, background: Sequence[float] = (0.0, 0.0, 0.0, 0.0)) -> None:
        """Clear, and draw here from now on."""
        self._buffer.use()
        self.context.viewport = (0, 0, *self.size)
        self._buffer.clear(*background, depth=1.0)
        self.context.enable_only(self.context.DEPTH_TEST)
        self.context.depth_func = "<"
        self.context.front_face = "cw"
        self._buffer.depth_mask = True
        self._faces = 0

    def blend(self) -> None:
        """From now on mix by alpha with what is there, and leave the depth as it is."""
        context = self.context
        context.enable(context.BLEND)
        context.blend_func = (
            context.SRC_ALPHA, context.ONE_MINUS_SRC_ALPHA,
            context.ONE, context.ONE_MINUS_SRC_ALPHA,
        )  # fmt: skip
        self._buffer.depth_mask = False

    def draw(
        self, program: Any, shape: Shape, matrix: NDArray[np.float64], uniforms: Mapping[str, Any]
    ) -> None:
        """Draw a shape by a matrix, clip from world."""
        everything = {**uniforms, **shape.uniforms, "first_face": self._faces + 1}
        set_uniforms(program, everything)
        arrays = {
            "clip_position": ("4f", to_clip(matrix, shape.positions)),
            "position": ("3f", shape.positions),
            "normal": ("3f", shape.normals),
            "uv": ("2f", shape.uv),
            "color": ("4f", shape.colors),
        }
        held, content = [], []
        for name, (layout, array) in arrays.items():
            if name not in program:
                continue
            if array is None:
                array = np.ones((len(shape.positions), int(layout[0])))
            held.append(self.context.buffer(np.ascontiguousarray(array, np.float32)))
            content.append((held[-1], layout, name))
        held.append(self.context.buffer(np.ascontiguousarray(shape.faces, np.int32)))
        drawn = self.context.vertex_array(program, content, index_buffer=held[-1])
        drawn.render(self.context.TRIANGLES)
        self._faces += len(shape.faces)
        for thing in (drawn, *held):
            thing.release()

    def read(self) -> Seen:
        """Return the picture; of one with samples the mean of each pixel, in linear light."""
        height, width = self.size[1], self.size[0]
        self.context.finish()
        if self.samples:
            means = read_samples(self).mean(axis=0)
            return Seen(means.astype(np.float32), np.full((height, width), -1, np.int32))
        color = np.frombuffer(self.color.read(), np.float32).reshape(height, width, 4).copy()
        face = np.frombuffer(self.face.read(), np.int32).reshape(height, width) - 1
        return Seen(color, face)

    def release(self) -> None:
        """Give the memory back."""
        for thing in (self._buffer, self._depth, self.face, self.color):
            thing.release()


SAMPLE_PLACES = """
vec4 shade() { return vec4(gl_SamplePosition, float(gl_SampleID), 1.0); }
"""


def sample_positions(samples: int) -> NDArray[np.float64]:
    """Return where OpenGL takes the samples of a pixel, (S, 2), x right and y down, 0..1."""
    sheet = Sheet((4, 4), samples)
    sheet.begin()
    corners = np.array([(-1, -1, 0), (3, -1, 0), (-1, 3, 0)], np.float64)
    everywhere = Shape(corners, np.array([(0, 1, 2)], np.int32))
    sheet.draw(compiled((SAMPLE_PLACES,)), everywhere, np.eye(4), {})
    places = read_samples(sheet)[:, 1, 1]
    sheet.release()
    assert places[:, 2].tolist() == list(range(samples))
    # Rows are turned over by what draws, so that OpenGL's upwards is downwards here.
    return places[:, :2].astype(np.float64)


SHEET_VERTEX = """
#version 400
const vec2 corners[3] = vec2[3](vec2(-1.0, -1.0), vec2(3.0, -1.0), vec2(-1.0, 3.0));
void main() { gl_Position = vec4(corners[gl_VertexID], 0.0, 1.0); }
"""

ONE_SAMPLE = """
#version 400
uniform sampler2DMS samples;
uniform int number;
out vec4 seen;
void main() { seen = texelFetch(samples, ivec2(gl_FragCoord.xy), number); }
"""


def read_samples(sheet: Sheet) -> NDArray[np.float32]:
    """Return every sample of a sheet, (S, H, W, 4)."""
    context = sheet.context
    program = whole_sheet(ONE_SAMPLE)
    found = []
    for number in range(sheet.samples):
        target = context.texture(sheet.size, 4, dtype="f4")
        buffer = context.framebuffer([target])
        buffer.use()
        context.enable_only(context.NOTHING)
        sheet.color.use(0)
        set_uniforms(program, {"number": number})
        fill(program)
        pixels = np.frombuffer(target.read(), np.float32)
        found.append(pixels.reshape(sheet.size[1], sheet.size[0], 4).copy())
        buffer.release()
        target.release()
    return np.stack(found)


@functools.cache
def whole_sheet(fragment: str) -> Any:
    """Return a program that draws every pixel of a sheet."""
    return require_opengl().program(SHEET_VERTEX, fragment)


def fill(program: Any) -> None:
    """Draw one triangle that covers everything."""
    array = require_opengl().vertex_array(program, [])
    array.render(vertices=3)
    array.release()


def draw_scene(
    shapes: Sequence[Shape],
    camera: Any,
    size: tuple[int, int],
    parts: tuple[str, ...],
    uniforms: Mapping[str, Any] | None = None,
    textures: Mapping[str, Any] | None = None,
    samples: int = 0,
    background: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
) -> Seen:
    """Draw shapes with one program and return the picture."""
    sheet, program = Sheet(size, samples), compiled(parts)
    shared = {"eye": camera.eye_position(), **(uniforms or {})}
    for unit, (name, texture) in enumerate((textures or {}).items()):
        texture.use(unit)
        shared[name] = unit
    sheet.begin(background)
    for shape in shapes:
        sheet.draw(program, shape, clip_from_world(camera, size), shared)
    seen = sheet.read()
    sheet.release()
    return seen


# Shadows

DEPTH_ONLY = """
#version 400
void main() {}
"""

POSITIONS_ONLY = """
#version 400
in vec4 clip_position;
void main() { gl_Position = clip_position; }
"""

SLOPE_OFFSET = (3.0, 4.0)
"""Of ``glPolygonOffset``: in slopes of the surface, and in least steps of the depth buffer."""


def shadow_map(shapes: Sequence[Shape], matrix: NDArray[np.float64], side: int) -> Any:
    """
    Return a map of the depths that a light sees, float32, which compares as it is sampled.

    Parameters
    ----------
    shapes : sequence of Shape
        What casts the shadow.
    matrix : (4, 4), light clip from world
    side : int, texels
    """
    context = require_opengl()
    texture = context.depth_texture((side, side))
    texture.compare_func = "<="
    texture.filter = context.LINEAR, context.LINEAR
    texture.repeat_x = texture.repeat_y = False
    buffer = context.framebuffer(depth_attachment=texture)
    buffer.use()
    context.viewport = (0, 0, side, side)
    buffer.clear(depth=1.0)
    context.enable_only(context.DEPTH_TEST)
    context.depth_func = "<"
    context.polygon_offset = SLOPE_OFFSET
    program = context.program(POSITIONS_ONLY, DEPTH_ONLY)
    for shape in shapes:
        points = context.buffer(to_clip(matrix, shape.positions).astype(np.float32))
        indices = context.buffer(np.ascontiguousarray(shape.faces, np.int32))
        array = context.vertex_array(program, [(points, "4f", "clip_position")], indices)
        array.render(context.TRIANGLES)
        for thing in (array, points, indices):
            thing.release()
    context.polygon_offset = (0.0, 0.0)
    buffer.release()
    return texture


TO_UNIT = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1.0]])
"""From -1..1 to 0..1 in three axes."""


# Textures


def halved(level: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means of two by two texels; sides of a power of two."""
    for axis in (0, 1):
        if level.shape[axis] > 1:
            level = (level.take(range(0, level.shape[axis], 2), axis)
                     + level.take(range(1, level.shape[axis], 2), axis)) / 2.0  # fmt: skip
    return level


def upload(image: ArrayLike, filter: str, wrap: str = "repeat", anisotropy: float = 1.0) -> Any:
    """
    Return a texture of float32, linear light, with a mip chain made here.

    Parameters
    ----------
    image : (H, W, 4), linear, row 0 on top; sides are powers of two
    filter : {"nearest", "bilinear", "trilinear"}
    wrap : {"repeat", "clamp"}
    anisotropy : float
        Most samples along the longer side of a footprint.
    """
    context = require_opengl()
    level = np.asarray(image, np.float64)
    texture = context.texture((level.shape[1], level.shape[0]), 4, dtype="f4")
    if filter == "trilinear":
        texture.build_mipmaps()
    number = 0
    while True:
        # OpenGL counts rows from the bottom, where v is 0.
        texture.write(np.ascontiguousarray(level[::-1], np.float32).tobytes(), level=number)
        if filter != "trilinear" or level.shape[:2] == (1, 1):
            break
        level, number = halved(level), number + 1
    texture.filter = {
        "nearest": (context.NEAREST, context.NEAREST),
        "bilinear": (context.LINEAR, context.LINEAR),
        "trilinear": (context.LINEAR_MIPMAP_LINEAR, context.LINEAR),
    }[filter]
    texture.repeat_x = texture.repeat_y = wrap == "repeat"
    texture.anisotropy = anisotropy
    return texture


# Comparing


class Difference(NamedTuple):
    """How far two pictures are apart, in steps of 8-bit sRGB before rounding."""

    pixels: int
    """Compared."""
    mean: float
    """Over pixels and channels."""
    largest: float
    beyond: float
    """Share of the pixels with a channel more than one step off."""

    def __str__(self) -> str:
        return (
            f"{self.pixels} pixels, mean {self.mean:.4f} / 255, largest {self.largest:.2f} / 255, "
            f"{self.beyond:.4%} beyond one step"
        )


def encode(linear: ArrayLike) -> NDArray[np.float64]:
    """Return linear light in steps of 8-bit sRGB, not rounded (IEC 61966-2-1)."""
    value = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    return 255.0 * np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def difference(ours: ArrayLike, theirs: ArrayLike, where: NDArray[np.bool_]) -> Difference:
    """Compare linear colours, (H, W, 3 or 4), at the pixels of a mask; print and return it."""
    apart = np.abs(
        encode(np.asarray(ours)[where][:, :3]) - encode(np.asarray(theirs)[where][:, :3])
    )
    found = Difference(
        len(apart), float(apart.mean()), float(apart.max()), float((apart > 1.0).any(axis=1).mean())
    )
    print(found)
    return found


def grown(mask: NDArray[np.bool_], steps: int = 1) -> NDArray[np.bool_]:
    """Return a mask with the pixels around it, so many steps in all eight directions."""
    wide = np.pad(mask, steps)
    found = np.zeros_like(mask)
    height, width = mask.shape
    for down in range(2 * steps + 1):
        for across in range(2 * steps + 1):
            found |= wide[down : down + height, across : across + width]
    return found


# Shapes


def torus(rings: int = 48, sides: int = 24, radius: float = 1.0, tube: float = 0.42) -> Shape:
    """Return a torus about the y axis with normals, and uv that go round it four times and once."""
    u, v = np.meshgrid(np.arange(rings + 1) / rings, np.arange(sides + 1) / sides, indexing="ij")
    around, across = 2.0 * np.pi * u.ravel(), 2.0 * np.pi * v.ravel()
    outward = np.stack([np.cos(around), np.zeros_like(around), -np.sin(around)], axis=1)
    normals = np.cos(across)[:, None] * outward
    normals[:, 1] = np.sin(across)
    positions = radius * outward + tube * normals
    return Shape(
        positions.astype(np.float32).astype(np.float64), grid_faces(rings, sides), normals,
        np.stack([4.0 * u.ravel(), v.ravel()], axis=1),
    )  # fmt: skip


def sphere(radius: float = 1.0, center: ArrayLike = (0.0, 0.0, 0.0), bands: int = 32) -> Shape:
    """Return a sphere with normals."""
    u, v = np.meshgrid(
        np.arange(2 * bands + 1) / (2 * bands), np.arange(bands + 1) / bands, indexing="ij"
    )
    around, down = 2.0 * np.pi * u.ravel(), np.pi * v.ravel()
    normals = np.stack(
        [np.sin(down) * np.cos(around), -np.cos(down), -np.sin(down) * np.sin(around)], axis=1
    )
    return Shape(
        np.asarray(center) + radius * normals, grid_faces(2 * bands, bands), normals,
        np.stack([u.ravel(), v.ravel()], axis=1),
    )  # fmt: skip


def plane(
    corner: ArrayLike, right: ArrayLike, up: ArrayLike, steps: int = 1, repeats: float = 1.0
) -> Shape:
    """Return a flat grid from a corner along two sides; its front is where right x up points."""
    corner, right, up = (np.asarray(each, np.float64) for each in (corner, right, up))
    u, v = np.meshgrid(np.arange(steps + 1) / steps, np.arange(steps + 1) / steps, indexing="ij")
    u, v = u.reshape(-1, 1), v.reshape(-1, 1)
    normal = np.cross(right, up)
    return Shape(
        corner + u * right + v * up, grid_faces(steps, steps),
        np.tile(normal / np.linalg.norm(normal), (len(u), 1)),
        repeats * np.concatenate([u, v], axis=1),
    )  # fmt: skip


def grid_faces(columns: int, rows: int) -> NDArray[np.int32]:
    """Return two faces for each cell of a grid of vertices, counter-clockwise."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    a = (i * (rows + 1) + j).ravel()
    b, c, d = a + rows + 1, a + rows + 2, a + 1
    return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3).astype(np.int32)
