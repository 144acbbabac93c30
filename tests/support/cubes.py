"""The corners and faces of a cube."""

import numpy as np

# Eight corners of the cube [-1, 1]**3, numbered by the bits z, y, x; faces wind outwards.
CUBE_VERTICES = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
CUBE_FACES = np.array(
    [
        [0, 2, 3], [0, 3, 1],  # back, -z
        [4, 5, 7], [4, 7, 6],  # front, +z
        [0, 4, 6], [0, 6, 2],  # left, -x
        [1, 3, 7], [1, 7, 5],  # right, +x
        [0, 1, 5], [0, 5, 4],  # bottom, -y
        [2, 6, 7], [2, 7, 3],  # top, +y
    ]
)  # fmt: skip
