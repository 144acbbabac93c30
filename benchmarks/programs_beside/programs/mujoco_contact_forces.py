"""
Contacts and their forces, with bodies that are seen through, followed by a camera.

https://github.com/google-deepmind/mujoco/blob/main/python/tutorial.ipynb
"""

import mujoco
import numpy as np

XML = """
<mujoco>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".1 .3 .2" rgb2=".2 .4 .3"
      width="256" height="256" mark="edge" markrgb=".3 .5 .4"/>
    <material name="tiles" texture="tiles" texrepeat="3 3" texuniform="true" reflectance=".2"/>
  </asset>
  <worldbody>
    <light pos="0 0 1" mode="trackcom"/>
    <geom type="plane" pos="0 0 -.4" size="2 2 .1" material="tiles" solref=".002 1"/>
    <body name="die">
      <freejoint/>
      <geom type="box" size=".1 .1 .1" rgba=".9 .1 .1 1" solref=".002 1"/>
      <geom size=".05" pos=".11 .1 .1" rgba=".1 .9 .1 1"/>
      <camera name="follow" pos="0 -.6 .3" xyaxes="1 0 0 0 1 2" mode="track"/>
    </body>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
options = mujoco.MjvOption()
mujoco.mjv_defaultOption(options)
options.flags[mujoco.mjtVisFlag.mjVIS_CONTACTPOINT] = True
options.flags[mujoco.mjtVisFlag.mjVIS_CONTACTFORCE] = True
options.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
model.vis.scale.contactwidth = 0.1
model.vis.scale.contactheight = 0.03
model.vis.scale.forcewidth = 0.05
model.vis.map.force = 0.3
mujoco.mj_resetData(model, data)
data.qvel[3:6] = 5 * np.random.default_rng(1).standard_normal(3)
frames = []
with mujoco.Renderer(model, 240, 320) as renderer:
    for i in range(60):
        while data.time < i / 40.0:
            mujoco.mj_step(model, data)
        renderer.update_scene(data, "follow", options)
        frames.append(renderer.render())
