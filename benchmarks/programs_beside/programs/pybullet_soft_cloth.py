"""
A cloth with a texture hangs at two corners while a box falls on it; a soft bunny beside it.

https://github.com/bulletphysics/bullet3/blob/master/examples/pybullet/examples/deformable_anchor.py
"""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD)
p.setGravity(0, 0, -10)
p.loadURDF("plane.urdf", [0, 0, 0])
box = p.loadURDF("cube.urdf", [0, 1, 4], useMaximalCoordinates=True)
cloth = p.loadSoftBody(
    "cloth_z_up.obj", basePosition=[0, 0, 2], scale=0.5, mass=1.0, useNeoHookean=0,
    useBendingSprings=1, useMassSpring=1, springElasticStiffness=40, springDampingStiffness=0.1,
    springDampingAllDirections=1, useSelfCollision=0, frictionCoeff=0.5, useFaceContact=1,
)  # fmt: skip
texture = p.loadTexture("uvmap.png")
p.changeVisualShape(cloth, -1, rgbaColor=[1, 1, 1, 1], textureUniqueId=texture)
bunny = p.loadSoftBody("bunny.obj", basePosition=[2, 0, 1], simFileName="", mass=1, useMassSpring=1)
p.setPhysicsEngineParameter(sparseSdfVoxelSize=0.25)
for corner in (24, 20, 15):
    p.createSoftBodyAnchor(cloth, corner, -1, -1)
view = p.computeViewMatrixFromYawPitchRoll([0.5, 0, 1.2], 5, 40, -25, 0, 2)
projection = p.computeProjectionMatrixFOV(60, 1.6, 0.1, 30)
frames, depths, numbers = [], [], []
for _ in range(8):
    for _ in range(20):
        p.stepSimulation()
    image = p.getCameraImage(320, 200, view, projection)
    frames.append(image[2])
    depths.append(image[3])
    numbers.append(image[4])
