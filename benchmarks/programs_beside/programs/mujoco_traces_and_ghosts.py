"""
What programs add to the scene: a trace of capsules, and a second state that is seen through.

https://github.com/google-deepmind/mujoco/blob/main/python/tutorial.ipynb
"""

import gymnasium.envs.mujoco
import mujoco
import numpy as np

FOLDER = gymnasium.envs.mujoco.__path__[0]
model = mujoco.MjModel.from_xml_path(f"{FOLDER}/assets/humanoid.xml")
data, ghost = mujoco.MjData(model), mujoco.MjData(model)
ghost_look = mujoco.MjvOption()
ghost_look.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
perturbation = mujoco.MjvPerturb()
phase = 2 * np.pi * np.random.default_rng(0).random(model.nu)


def add_capsule(scene, start, end, radius, rgba):
    if scene.ngeom >= scene.maxgeom:
        return
    scene.ngeom += 1
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    geom = scene.geoms[scene.ngeom - 1]
    mujoco.mjv_initGeom(
        geom, capsule, np.zeros(3), np.zeros(3), np.zeros(9), np.array(rgba, np.float32)
    )
    mujoco.mjv_connector(geom, capsule, radius, start, end)


data.qpos[:2] = -0.5, -0.5
data.qvel[2] = 4
frames, path = [], []
with mujoco.Renderer(model, 480, 640) as renderer:
    while data.time < 1.5:
        data.ctrl = np.sin(phase + 2 * np.pi * data.time)
        mujoco.mj_step(model, data)
        path.append(data.body("torso").xpos.copy())
        if len(frames) < data.time * 20:
            renderer.update_scene(data)
            ghost.qpos = data.qpos
            ghost.qpos[:2] += 1.5, 1.0
            mujoco.mj_forward(model, ghost)
            mujoco.mjv_addGeoms(
                model, ghost, ghost_look, perturbation, mujoco.mjtCatBit.mjCAT_DYNAMIC,
                renderer.scene,
            )  # fmt: skip
            for i in range(0, len(path) - 5, 5):
                add_capsule(
                    renderer.scene, path[i], path[i + 5], 0.02, (1 - i / 500, i / 500, 0.5, 1)
                )
            frames.append(renderer.render())
