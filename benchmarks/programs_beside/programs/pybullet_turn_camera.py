"""
Turn a camera about a robot.

https://github.com/bulletphysics/bullet3/blob/master/examples/pybullet/examples/testrender_np.py
"""

import pybullet
import pybullet_data

pybullet.connect(pybullet.DIRECT)
pybullet.setAdditionalSearchPath(pybullet_data.getDataPath())
pybullet.loadURDF("plane.urdf", [0, 0, -1])
pybullet.loadURDF("r2d2.urdf")
pybullet.setGravity(0, 0, -10)
width, height = 320, 200
frames, depths, numbers = [], [], []
for yaw in range(0, 360, 10):
    pybullet.stepSimulation()
    view = pybullet.computeViewMatrixFromYawPitchRoll([0, 0, 0], 4, yaw, -10.0, 0, 2)
    projection = pybullet.computeProjectionMatrixFOV(60, width / height, 0.01, 100)
    image = pybullet.getCameraImage(
        width, height, view, projection, shadow=1, lightDirection=[1, 1, 1],
        renderer=pybullet.ER_BULLET_HARDWARE_OPENGL,
    )  # fmt: skip
    frames.append(image[2])
    depths.append(image[3])
    numbers.append(image[4])
