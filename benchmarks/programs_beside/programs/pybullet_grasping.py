"""
What a learner sees that grasps: an arm over a tray of random objects, 48x48.

https://github.com/bulletphysics/bullet3/blob/master/examples/pybullet/gym/pybullet_envs/bullet/kuka_diverse_object_gym_env.py
"""

import math
import os
import random

import pybullet as p
import pybullet_data

ROOT = pybullet_data.getDataPath()
random.seed(1)
p.connect(p.DIRECT)
p.setPhysicsEngineParameter(numSolverIterations=150)
p.setTimeStep(1 / 240)
p.loadURDF(os.path.join(ROOT, "plane.urdf"), [0, 0, -1])
p.loadURDF(os.path.join(ROOT, "table/table.urdf"), [0.5, 0, -0.82])
p.setGravity(0, 0, -10)
arm = p.loadSDF(os.path.join(ROOT, "kuka_iiwa/kuka_with_gripper2.sdf"))[0]
p.resetBasePositionAndOrientation(arm, [-0.1, 0, 0.07], [0, 0, 0, 1])
p.loadURDF(os.path.join(ROOT, "tray/tray.urdf"), [0.64, 0.075, -0.19], [0, 0, 1, 0])
for number in random.sample(range(100), 5):
    name = f"random_urdfs/{number:03}/{number:03}.urdf"
    place = 0.4 + 0.3 * random.random(), 0.3 * (random.random() - 0.5), 0.15
    turn = p.getQuaternionFromEuler([0, 0, math.pi / 2 + 0.3 * math.pi * random.random()])
    p.loadURDF(os.path.join(ROOT, name), place, turn)
    for _ in range(100):
        p.stepSimulation()
view = p.computeViewMatrixFromYawPitchRoll([0.23, 0.2, 0.54], 1.0, 245, -56, 0, 2)
projection = p.computeProjectionMatrixFOV(20.0, 1.0, 0.01, 10)
frames, depths, numbers = [], [], []
for _ in range(20):
    p.setJointMotorControl2(arm, 5, p.POSITION_CONTROL, 0.4 * random.random(), force=200)
    for _ in range(20):
        p.stepSimulation()
    image = p.getCameraImage(width=48, height=48, viewMatrix=view, projectionMatrix=projection)
    frames.append(image[2])
    depths.append(image[3])
    numbers.append(image[4])
