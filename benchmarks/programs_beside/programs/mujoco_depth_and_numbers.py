"""
Depth, segmentation, and corners of a box projected by the camera of the scene.

https://github.com/google-deepmind/mujoco/blob/main/python/tutorial.ipynb
"""

import itertools

import mujoco
import numpy as np

XML = """
<mujoco>
  <worldbody>
    <light pos="0 0 1.2"/>
    <body name="crate" euler="0 0 -35">
      <joint type="hinge" axis="1 -1 0" pos="-.25 -.25 -.25"/>
      <geom name="side" type="box" size=".25 .25 .25" rgba="1 .2 0 1"/>
      <geom name="knob" pos=".25 .25 .25" size=".12" rgba=".2 .9 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
frames, depths, numbers = [], [], []
with mujoco.Renderer(model) as renderer:
    renderer.render()  # Nothing yet.
    mujoco.mj_forward(model, data)
    renderer.update_scene(data)
    frames.append(renderer.render())
    renderer.enable_depth_rendering()
    renderer.update_scene(data)
    depths.append(renderer.render())
    renderer.disable_depth_rendering()
    renderer.enable_segmentation_rendering()
    renderer.update_scene(data)
    numbers.append(renderer.render()[:, :, 0])
    renderer.disable_segmentation_rendering()

    renderer.update_scene(data)
    eyes = renderer.scene.camera
    up, back = (
        np.mean(axis, axis=0) for axis in ([e.up for e in eyes], [-e.forward for e in eyes])
    )
    rotation = np.vstack((np.cross(up, back), up, back))
    offsets = np.array([-1, 1]) * model.geom("side").size[:, None]
    corners = np.array([*itertools.product(*offsets)]) @ data.geom("side").xmat.reshape(3, 3).T
    corners += data.geom("side").xpos - np.mean([eye.pos for eye in eyes], axis=0)
    x, y, z = rotation @ corners.T
    focal = renderer.height / 2 / np.tan(np.deg2rad(model.vis.global_.fovy) / 2)
    column = np.rint((renderer.width - 1) / 2 - focal * x / z).astype(int)
    row = np.rint((renderer.height - 1) / 2 + focal * y / z).astype(int)
    marked = renderer.render()
    marked[row, column] = 255
    frames.append(marked)

    options = mujoco.MjvOption()
    options.frame = mujoco.mjtFrame.mjFRAME_GEOM
    options.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
    options.flags[mujoco.mjtVisFlag.mjVIS_JOINT] = True
    renderer.update_scene(data, scene_option=options)
    frames.append(renderer.render())
