"""
A top that turns over, on a floor that mirrors it, through a camera of the model.

https://github.com/google-deepmind/mujoco/blob/main/python/tutorial.ipynb
"""

import mujoco

XML = """
<mujoco>
  <option integrator="RK4"/>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".3 .2 .1" rgb2=".4 .3 .2"
      width="256" height="256"/>
    <material name="tiles" texture="tiles" texrepeat="9 9" reflectance=".25"/>
  </asset>
  <worldbody>
    <light pos="0 0 .7"/>
    <camera name="near" pos="0 -.12 .08" xyaxes="1 0 0 0 1 2"/>
    <geom type="plane" size=".25 .25 .01" material="tiles"/>
    <body name="spinner" pos="0 0 .022">
      <freejoint/>
      <geom type="sphere" size=".022" rgba=".8 .8 .8 1"/>
      <geom type="cylinder" pos="0 0 .022" size=".004 .009"/>
      <geom type="box" pos="0 0 -.016" size=".024 .024 .005" group="3" contype="0"
        conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.qvel[4:] = 1.0, 200.0
frames = []
with mujoco.Renderer(model) as renderer:
    while data.time < 2.0:
        mujoco.mj_step(model, data)
        if len(frames) < data.time * 15:
            renderer.update_scene(data, "near")
            frames.append(renderer.render())
