"""
OpenGL by moderngl, through EGL: vertices and faces read and lit as a first program would.

It has neither a reader of files, nor cameras, nor a writer of pictures: NumPy and Pillow do that.
"""

import json
import math
import os
import sys

os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "true")
import moderngl
import numpy as np
from PIL import Image

VERTEX_SHADER = """
#version 330
uniform mat4 clip_from_world;
in vec3 position;
out vec3 world;
void main() { gl_Position = clip_from_world * vec4(position, 1.0); world = position; }
"""
FRAGMENT_SHADER = """
#version 330
uniform vec3 eye;
in vec3 world;
out vec4 seen;
void main() {
    vec3 normal = normalize(cross(dFdx(world), dFdy(world)));
    float facing = abs(dot(normal, normalize(eye - world)));
    seen = vec4(vec3(0.2 + 0.8 * facing), 1.0);
}
"""


def read(path):
    """Return the positions, (V, 3), and triangles, (F, 3), of an OBJ file."""
    positions, triangles = [], []
    with open(path) as file:
        for line in file:
            words = line.split()
            if words and words[0] == "v":
                positions.append([float(word) for word in words[1:4]])
            elif words and words[0] == "f":
                corners = [int(word.partition("/")[0]) - 1 for word in words[1:]]
                triangles += [
                    (corners[0], corners[n], corners[n + 1]) for n in range(1, len(corners) - 1)
                ]
    return np.array(positions, np.float32), np.array(triangles, np.int32)


def clip_from_world(view):
    """Return the matrix of a camera, (4, 4)."""
    eye, ahead = np.array(view["eye"]), np.subtract(view["target"], view["eye"])
    backward = -ahead / np.linalg.norm(ahead)
    right = np.cross((0.0, 1.0, 0.0), backward)
    right /= np.linalg.norm(right)
    rows = np.array([right, np.cross(backward, right), backward])
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = rows, -rows @ eye
    near, far = 0.1, 100.0
    scale = 1.0 / math.tan(math.radians(view["fov_y"]) / 2.0)
    lens = np.zeros((4, 4))
    lens[0, 0], lens[1, 1] = scale * view["size"][1] / view["size"][0], scale
    lens[2, 2:] = (far + near) / (near - far), 2.0 * far * near / (near - far)
    lens[3, 2] = -1.0
    return lens @ placed


view = json.loads(sys.argv[1])
size = tuple(view["size"])
context = moderngl.create_standalone_context(backend="egl", require=330)
positions, triangles = read(view["model"])
program = context.program(VERTEX_SHADER, FRAGMENT_SHADER)
program["clip_from_world"].write(clip_from_world(view).T.astype(np.float32).tobytes())
program["eye"].write(np.float32(view["eye"]).tobytes())
array = context.vertex_array(
    program, [(context.buffer(positions), "3f", "position")], context.buffer(triangles)
)
target = context.simple_framebuffer(size)
target.use()
target.clear()
context.enable(context.DEPTH_TEST)
array.render()
pixels = np.frombuffer(target.read(), np.uint8).reshape(size[1], size[0], 3)
Image.fromarray(pixels[::-1]).save(view["picture"])
