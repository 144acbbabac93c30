"""
Make a ball of each fifth pixel, where its depth says, in its colour, and look at the cloud.

https://github.com/bulletphysics/bullet3/blob/master/examples/pybullet/examples/pointCloudFromCameraImage.py
"""

import numpy as np
import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
plane = p.loadURDF("plane100.urdf")
cube = p.loadURDF("cube.urdf", [0, 0, 1])
width, height = 160, 120
view = p.computeViewMatrixFromYawPitchRoll([0, 0, 0], 5, 50, -35, 0, 2)
projection = p.computeProjectionMatrixFOV(60, width / height, 0.01, 1000)
image = p.getCameraImage(width, height, view, projection)
ball = p.createVisualShape(p.GEOM_SPHERE, rgbaColor=[1, 1, 1, 1], radius=0.03)
to_world = np.linalg.inv(np.reshape(projection, (4, 4)).T @ np.reshape(view, (4, 4)).T)
for column in range(0, width, 5):
    for row in range(0, height, 5):
        x, y = 2 * (column + 0.5) / width - 1, 1 - 2 * (row + 0.5) / height
        point = to_world @ (x, y, 2 * float(image[3][row, column]) - 1, 1)
        body = p.createMultiBody(0, -1, ball, point[:3] / point[3], useMaximalCoordinates=True)
        p.changeVisualShape(body, -1, rgbaColor=[*(image[2][row, column, :3] / 255), 1])
p.removeBody(plane)
p.removeBody(cube)
view = p.computeViewMatrixFromYawPitchRoll([0, 0, 0], 5, 80, -20, 0, 2)
cloud = p.getCameraImage(width, height, view, projection)
frames, depths, numbers = zip(image[2:], cloud[2:], strict=True)
