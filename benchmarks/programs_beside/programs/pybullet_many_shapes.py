"""
Many ducks on boxes that share a shape of several parts, and a ball that is seen through.

https://github.com/bulletphysics/bullet3/blob/master/examples/pybullet/examples/createVisualShapeArray.py
"""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.loadURDF("plane100.urdf", useMaximalCoordinates=True)
scale = [0.1, 0.1, 0.1]
visual = p.createVisualShapeArray(
    shapeTypes=[p.GEOM_MESH, p.GEOM_BOX], halfExtents=[[0, 0, 0], [0.1, 0.1, 0.1]],
    fileNames=["duck.obj", ""], visualFramePositions=[[0, 0.1, 0], [0, 0, 0]],
    meshScales=[scale, scale],
)  # fmt: skip
collision = p.createCollisionShapeArray(
    shapeTypes=[p.GEOM_MESH, p.GEOM_BOX], halfExtents=[[0, 0, 0], [0.1, 0.1, 0.1]],
    fileNames=["duck_vhacd.obj", ""], collisionFramePositions=[[0, 0.1, 0], [0, 0, 0]],
    meshScales=[scale, scale],
)  # fmt: skip
colors = [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [1, 1, 1, 1]]
for i in range(4):
    for j in range(4):
        body = p.createMultiBody(1, collision, visual, [0.4 * (i - 2), 0.4 * (j - 2), 1])
        p.changeVisualShape(body, -1, rgbaColor=colors[(i + j) % 4])
ball = p.loadURDF("sphere_transparent.urdf", [0, 0, 2])
p.changeVisualShape(ball, -1, rgbaColor=[1, 0, 0, 0.5])
p.setGravity(0, 0, -10)
view = p.computeViewMatrixFromYawPitchRoll([0, 0, 0.5], 3, 30, -30, 0, 2)
projection = p.computeProjectionMatrixFOV(60, 1.6, 0.1, 30)
frames, depths, numbers = [], [], []
for _ in range(10):
    for _ in range(10):
        p.stepSimulation()
    image = p.getCameraImage(
        320, 200, view, projection, flags=p.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX,
        renderer=p.ER_BULLET_HARDWARE_OPENGL,
    )  # fmt: skip
    frames.append(image[2])
    depths.append(image[3])
    numbers.append(image[4])
