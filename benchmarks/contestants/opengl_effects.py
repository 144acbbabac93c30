"""
OpenGL on a CPU drawing effects: Mesa's llvmpipe, shaders written for one effect each.

Everything is done in the way that suits OpenGL: 8-bit textures in sRGB that the hardware's formats
decode, mip levels made by the driver, samples resolved by a blit, depth and colour drawn into the
smallest formats that hold them. Colours are written to a linear RGBA8 target, which asks for no
sRGB encoding. Layers are peeled front to back: as many passes over all of them as there are layers,
each of which shows what lies behind the last (C. Everitt, "Interactive Order-Independent
Transparency", 2001); the number of layers is known, so no query asks whether one is left.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import effects_scenes as fx
from benchmarks.contestants import Prepared
from benchmarks.contestants.opengl import available, environment, open_context
from benchmarks.effects_scenes import EffectScene, Part

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "Mesa llvmpipe"

VERTEX_SHADER = """
uniform mat4 clip_from_world;
in vec3 position;
#ifdef LIGHTING
in vec3 normal;
out vec3 mixed_normal;
out vec3 world;
#endif
#ifdef TEXTURE
in vec2 uv;
out vec2 place;
#endif
#ifdef COLORS
in vec4 color;
out vec4 mixed;
#endif
#ifdef SHADOW
uniform mat4 shadow_from_world;
out vec3 in_shadow_map;
#endif
void main() {
    vec4 clip = clip_from_world * vec4(position, 1.0);
    gl_Position = vec4(clip.x, -clip.y, clip.zw);
#ifdef LIGHTING
    mixed_normal = normal;
    world = position;
#endif
#ifdef TEXTURE
    place = uv;
#endif
#ifdef COLORS
    mixed = color;
#endif
#ifdef SHADOW
    in_shadow_map = (shadow_from_world * vec4(position, 1.0)).xyz;
#endif
}
"""

FRAGMENT_SHADER = """
#ifdef LIGHTING
uniform vec3 eye;
uniform vec3 to_light;
uniform float ambient;
uniform float specular;
uniform float shininess;
uniform float metallic;
uniform float roughness;
in vec3 mixed_normal;
in vec3 world;
#endif
#ifdef TEXTURE
uniform sampler2D picture;
in vec2 place;
#endif
#ifdef COLORS
in vec4 mixed;
#endif
#ifdef SHADOW
uniform sampler2DShadow shadow_map;
const float BIAS = 1e-3;
in vec3 in_shadow_map;
#endif
#ifdef PEELING
uniform sampler2D last_depth;
#endif
uniform float alpha_cutoff;
uniform vec3 fog_color;
uniform float fog_density;
uniform float fog_height;
uniform float fog_falloff;
uniform float exposure;
out vec4 seen;

float lit_share() {
#ifdef SHADOW
    float step_ = 1.0 / float(textureSize(shadow_map, 0).x);
    float sum = 0.0;
    for (int down = -1; down <= 1; ++down)
        for (int across = -1; across <= 1; ++across)
            sum += texture(shadow_map, in_shadow_map + vec3(across * step_, down * step_, -BIAS));
    return sum / 9.0;
#else
    return 1.0;
#endif
}

#ifdef LIGHTING
vec3 lit(vec3 base) {
    vec3 normal = normalize(gl_FrontFacing ? mixed_normal : -mixed_normal);
    vec3 viewer = normalize(eye - world);
    vec3 middle = normalize(to_light + viewer);
    float facing = max(dot(normal, to_light), 0.0);
#ifdef MICROFACETS
    float n_v = max(dot(normal, viewer), 1e-4), n_h = dot(normal, middle);
    float squared = roughness * roughness * roughness * roughness;
    float below = n_h * n_h * (squared - 1.0) + 1.0;
    float light_side = n_v * sqrt(facing * facing * (1.0 - squared) + squared);
    float viewer_side = facing * sqrt(n_v * n_v * (1.0 - squared) + squared);
    float shine = squared * 0.5 / (below * below * (light_side + viewer_side));
    float rest = 1.0 - abs(dot(viewer, middle));
    float grazing = rest * rest * rest * rest * rest;
    vec3 head_on = mix(vec3(0.04), base, metallic);
    vec3 diffuse = base * (1.0 - metallic) * (0.96 - 0.96 * grazing);
    vec3 mirrored = (head_on + (1.0 - head_on) * grazing) * shine;
    return (diffuse + mirrored) * facing * lit_share();
#else
    float shine = facing > 0.0 ? specular * pow(max(dot(normal, middle), 0.0), shininess) : 0.0;
    return base * ambient + (base * facing + shine) * lit_share();
#endif
}
#endif

#ifdef TONE_MAP
vec3 toned(vec3 light) {
#ifdef REINHARD
    return light / (1.0 + dot(light, vec3(0.2126, 0.7152, 0.0722)));
#endif
#ifdef ACES
    // S. Hill's fit; matrices are written column by column.
    const mat3 to_film = mat3(
        0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383, 0.04823, 0.01566, 0.83777);
    const mat3 to_screen = mat3(
        1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276, -0.07367, -0.00605, 1.07602);
    vec3 film = to_film * light;
    film = (film * (film + 0.0245786) - 0.000090537)
        / (film * (0.983729 * film + 0.4329510) + 0.238081);
    return clamp(to_screen * film, 0.0, 1.0);
#endif
#ifdef NEUTRAL
    const float start = 0.76;
    float least = min(light.r, min(light.g, light.b));
    light -= least < 0.08 ? least - 6.25 * least * least : 0.04;
    float peak = max(light.r, max(light.g, light.b));
    if (peak < start) return light;
    float lowered = 1.0 - (1.0 - start) * (1.0 - start) / (peak + 1.0 - 2.0 * start);
    float pale = 1.0 - 1.0 / (0.15 * (peak - lowered) + 1.0);
    return mix(light * (lowered / peak), vec3(lowered), pale);
#endif
}
#endif

void main() {
#ifdef PEELING
    const float step_of_depth = 1.0 / 16777216.0;
    float last = texelFetch(last_depth, ivec2(gl_FragCoord.xy), 0).r;
    if (gl_FragCoord.z <= last + step_of_depth) discard;
#endif
    vec4 color = vec4(1.0);
#ifdef TEXTURE
    color = texture(picture, place);
#endif
#ifdef COLORS
    color *= mixed;
#endif
#ifdef MASK
    if (color.a < alpha_cutoff) discard;
    color.a = 1.0;
#endif
#ifdef LIGHTING
    color.rgb = lit(color.rgb);
#endif
#ifdef FOG
    float far = fog_density * distance(eye, world);
    color.rgb = mix(fog_color, color.rgb, exp(-far * far));
#endif
#ifdef HEIGHT_FOG
    float rise = fog_falloff * (world.y - eye.y);
    float mean = abs(rise) > 1e-3 ? (1.0 - exp(-rise)) / rise : 1.0 - 0.5 * rise;
    float depth = fog_density * exp(-fog_falloff * (eye.y - fog_height)) * mean;
    color.rgb = mix(fog_color, color.rgb, exp(-depth * distance(eye, world)));
#endif
#ifdef TONE_MAP
    color.rgb = toned(color.rgb * exp2(exposure));
#endif
#ifdef OPAQUE
    color.a = 1.0;
#endif
    seen = color;
}
"""

DEPTH_VERTEX_SHADER = """
uniform mat4 shadow_from_world;
in vec3 position;
void main() {
    vec4 unit = shadow_from_world * vec4(position, 1.0);
    gl_Position = vec4(2.0 * unit.xyz - 1.0, 1.0);
}
"""
DEPTH_FRAGMENT_SHADER = "void main() {}"

WHOLE_VERTEX_SHADER = """
const vec2 corners[3] = vec2[3](vec2(-1.0, -1.0), vec2(3.0, -1.0), vec2(-1.0, 3.0));
void main() { gl_Position = vec4(corners[gl_VertexID], 0.0, 1.0); }
"""
UNDER_SHADER = """
uniform sampler2D layer;
out vec4 seen;
void main() {
    vec4 color = texelFetch(layer, ivec2(gl_FragCoord.xy), 0);
    seen = vec4(color.rgb * color.a, color.a);
}
"""

SLOPE_OFFSET = (3.0, 4.0)
"""Of ``glPolygonOffset``, so that a lit surface casts no shadow on itself."""


def draws(scene: EffectScene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    asked = (
        scene.environment, scene.maps, scene.occlusion, scene.eye_dome, scene.outline,
        scene.wireframe,
    )  # fmt: skip
    if any(asked) or scene.shading in ("flat", "gouraud"):
        return "it has no twin here"
    if scene.light != "sun" or scene.shadow == "soft":
        return "it has no twin of this light here"
    if scene.samples not in (1, fx.SAMPLES):
        return f"llvmpipe has {fx.SAMPLES} samples of a pixel, or one"
    return None


def prepare(scene: EffectScene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    return Peeled(scene) if scene.alpha == "blend" else Picture(scene)


def defines_of(scene: EffectScene) -> list[str]:
    """Return what of the shaders a scene asks for."""
    asked = {
        "LIGHTING": scene.shading != "unlit",
        "MICROFACETS": scene.shading == "pbr",
        "TEXTURE": scene.filter is not None,
        "COLORS": scene.parts[0].colors is not None,
        "MASK": scene.alpha == "mask",
        "OPAQUE": scene.alpha == "opaque",
        "FOG": scene.fog == "exp2",
        "HEIGHT_FOG": scene.fog == "height",
        "TONE_MAP": scene.tone_map is not None,
        "SHADOW": scene.shadow is not None,
    }
    curve = [] if scene.tone_map is None else [scene.tone_map.upper()]
    return [*(name for name, is_asked in asked.items() if is_asked), *curve]


def with_defines(shader: str, defines: list[str]) -> str:
    """Return a shader's text with its version and what is defined in it."""
    return "\n".join(["#version 330", *(f"#define {name}" for name in defines), shader])


def set_uniforms(program: Any, values: dict[str, Any]) -> None:
    """Set what the shader has of these."""
    for name, value in values.items():
        if name in program:
            kind = np.int32 if program[name].fmt.endswith("i") else np.float32
            program[name].write(np.array(value, kind).tobytes())


def light_matrix(parts: tuple[Part, ...]) -> NDArray[np.float64]:
    """Return the matrix, (4, 4), that takes the casters as the light sees them to 0..1."""
    back = np.array(fx.TO_LIGHT)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), -back])
    seen = parts[0].positions @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    # What receives the shadow lies behind the casters.
    high[2] = max(float((part.positions @ -back).max()) for part in parts)
    margin = 4.0 * (high - low) / fx.SHADOW_SIDE
    low, high = low - margin, high + margin
    matrix = np.eye(4)
    matrix[:3, :3] = axes / (high - low)[:, None]
    matrix[:3, 3] = -low / (high - low)
    return matrix


class Picture:
    """A scene uploaded, and a target for its picture."""

    def __init__(self, scene: EffectScene) -> None:
        self.scene = scene
        self.context = open_context()
        width, height = scene.size
        self._pixels = np.empty((height, width, 4), np.uint8)
        self._target = self.context.texture(scene.size, 4, dtype="f1")
        self.values: dict[str, Any] = {
            "clip_from_world": scene.clip_from_world.T, "eye": scene.eye, "to_light": fx.TO_LIGHT,
            "ambient": fx.AMBIENT, "specular": fx.SPECULAR, "shininess": fx.SHININESS,
            "metallic": fx.METALLIC, "roughness": fx.ROUGHNESS, "alpha_cutoff": fx.ALPHA_CUTOFF,
            "fog_color": fx.FOG_COLOR, "fog_density": fx.FOG_DENSITY, "fog_height": fx.FOG_HEIGHT,
            "fog_falloff": fx.FOG_FALLOFF, "exposure": fx.EXPOSURE,
            "picture": 0, "shadow_map": 1, "last_depth": 2,
        }  # fmt: skip
        self._held: list[Any] = []
        self._buffers = [self._upload(part) for part in scene.parts]
        if scene.filter is not None:
            self._texture = self._upload_texture()
        if scene.shadow is not None:
            self._make_shadow_map()
        self.arrays = self.arrays_of(defines_of(scene))
        self.framebuffer = self.context.framebuffer(
            [self._target], self.context.depth_renderbuffer(scene.size)
        )
        if scene.samples != 1:
            self._resolved = self.framebuffer
            self.framebuffer = self.context.framebuffer(
                [self.context.renderbuffer(scene.size, 4, samples=scene.samples)],
                self.context.depth_renderbuffer(scene.size, samples=scene.samples),
            )

    def _upload(self, part: Part) -> dict[str, tuple[Any, str]]:
        """Return the buffers of a mesh by the name of what is in them."""
        arrays = {
            "position": (part.positions, "3f"), "normal": (part.normals, "3f"),
            "uv": (part.uv, "2f"), "faces": (part.faces, ""),
        }  # fmt: skip
        if part.colors is not None:
            codes = np.rint(255.0 * part.colors).astype(np.uint8)
            arrays["color"] = (codes, "4f1")
        return {name: (self.context.buffer(array), form) for name, (array, form) in arrays.items()}

    def _upload_texture(self) -> Any:
        """Return the texture, 8-bit sRGB, with the driver's mip levels if its filter reads them."""
        context, filter = self.context, self.scene.filter
        image = np.ascontiguousarray(fx.picture()[::-1])
        srgb_with_alpha = 0x8C43
        texture = context.texture(
            (fx.TEXTURE_SIDE, fx.TEXTURE_SIDE), 4, image.tobytes(), internal_format=srgb_with_alpha
        )
        if filter in ("trilinear", "anisotropic"):
            texture.build_mipmaps()
        texture.filter = {
            "nearest": (context.NEAREST, context.NEAREST),
            "bilinear": (context.LINEAR, context.LINEAR),
        }.get(filter, (context.LINEAR_MIPMAP_LINEAR, context.LINEAR))
        if filter == "anisotropic":
            texture.anisotropy = float(fx.ANISOTROPY)
        texture.use(0)
        return texture

    def _make_shadow_map(self) -> None:
        """Prepare the pass that draws depths as the light sees them; what it draws, casts."""
        context, side = self.context, fx.SHADOW_SIDE
        self._map = context.depth_texture((side, side))
        self._map.compare_func = "<="
        self._map.filter = context.LINEAR, context.LINEAR
        self._map.repeat_x = self._map.repeat_y = False
        self._map_buffer = context.framebuffer(depth_attachment=self._map)
        matrix = light_matrix(self.scene.parts).T
        self.values["shadow_from_world"] = matrix
        program = context.program(
            with_defines(DEPTH_VERTEX_SHADER, []), with_defines(DEPTH_FRAGMENT_SHADER, [])
        )
        set_uniforms(program, self.values)
        caster = self._buffers[0]
        self._caster = context.vertex_array(
            program, [(caster["position"][0], "3f", "position")], caster["faces"][0]
        )
        self._map.use(1)

    def arrays_of(self, defines: list[str]) -> list[Any]:
        """Return all meshes, ready to be drawn by a program."""
        program = self.context.program(
            with_defines(VERTEX_SHADER, defines), with_defines(FRAGMENT_SHADER, defines)
        )
        set_uniforms(program, self.values)
        return [
            self.context.vertex_array(
                program,
                [(*held[name], name) for name in held if name in program],
                held["faces"][0],
            )
            for held in self._buffers
        ]

    def _draw_shadow_map(self) -> None:
        """Draw the depths that the light sees."""
        context = self.context
        self._map_buffer.use()
        context.viewport = (0, 0, fx.SHADOW_SIDE, fx.SHADOW_SIDE)
        self._map_buffer.clear(depth=1.0)
        context.polygon_offset = SLOPE_OFFSET
        self._caster.render(context.TRIANGLES)
        context.polygon_offset = (0.0, 0.0)

    def draw(self) -> None:
        """Clear, draw, and wait until llvmpipe has finished."""
        context = self.context
        context.enable_only(context.DEPTH_TEST)
        context.depth_func, context.front_face = "<", "cw"
        if self.scene.shadow is not None:
            self._draw_shadow_map()
        self.framebuffer.use()
        context.viewport = (0, 0, *self.scene.size)
        self.framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        for array in self.arrays:
            array.render(context.TRIANGLES)
        if self.scene.samples != 1:
            context.copy_framebuffer(self._resolved, self.framebuffer)
        context.finish()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture, top row first, in the same array every time."""
        self._target.read_into(self._pixels)
        return {"color": self._pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        self.read()
        return {
            "covered": self._pixels[:, :, 3] > 0,
            "color_linear": self._pixels[:, :, :3].copy(),
        }


class Peeled(Picture):
    """Layers in any order, peeled from the front, each put under those before."""

    def __init__(self, scene: EffectScene) -> None:
        super().__init__(scene)
        context = self.context
        self._sum = context.framebuffer([self._target])
        self._layer = context.texture(scene.size, 4, dtype="f1")
        self._depths = [context.depth_texture(scene.size) for _ in range(2)]
        for depth in self._depths:
            depth.compare_func = ""
            depth.filter = context.NEAREST, context.NEAREST
        self._passes = [context.framebuffer([self._layer], depth) for depth in self._depths]
        self._peel = self.arrays_of([*defines_of(scene), "PEELING"])
        under = context.program(
            with_defines(WHOLE_VERTEX_SHADER, []), with_defines(UNDER_SHADER, [])
        )
        set_uniforms(under, {"layer": 3})
        self._under = context.vertex_array(under, [])

    def draw(self) -> None:
        """Peel layer after layer, and wait until llvmpipe has finished."""
        context = self.context
        context.viewport = (0, 0, *self.scene.size)
        context.depth_func, context.front_face = "<", "cw"
        context.blend_func = (
            context.ONE_MINUS_DST_ALPHA, context.ONE, context.ONE_MINUS_DST_ALPHA, context.ONE,
        )  # fmt: skip
        self._sum.clear(0.0, 0.0, 0.0, 0.0)
        self._layer.use(3)
        for number in range(fx.LAYERS):
            buffer = self._passes[number % 2]
            buffer.use()
            context.enable_only(context.DEPTH_TEST)
            buffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
            self._depths[1 - number % 2].use(2)
            for array in self._peel if number else self.arrays:
                array.render(context.TRIANGLES)
            self._sum.use()
            context.enable_only(context.BLEND)
            self._under.render(context.TRIANGLES, vertices=3)
        context.finish()
