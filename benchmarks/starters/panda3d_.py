"""Panda3D's tinydisplay, which draws in software, off screen."""

import json
import sys

import panda3d.core as panda

view = json.loads(sys.argv[1])
panda.load_prc_file_data(
    "",
    "audio-library-name null\nnotify-level fatal\nload-file-type p3assimp\n"
    "coordinate-system yup-right\n",
)
pipe = panda.GraphicsPipeSelection.get_global_ptr().make_module_pipe("p3tinydisplay")
engine = panda.GraphicsEngine()
wanted = panda.FrameBufferProperties()
wanted.set_rgba_bits(8, 8, 8, 8)
wanted.set_depth_bits(24)
flags = panda.GraphicsPipe.BF_refuse_window | panda.GraphicsPipe.BF_fb_props_optional
size = panda.WindowProperties.size(*view["size"])
buffer = engine.make_output(pipe, "picture", 0, wanted, size, flags)
buffer.set_clear_color((0.0, 0.0, 0.0, 1.0))
texture = panda.Texture()
buffer.add_render_texture(texture, panda.GraphicsOutput.RTM_copy_ram)

root = panda.NodePath("root")
model = panda.Filename.from_os_specific(view["model"])
model = root.attach_new_node(panda.Loader.get_global_ptr().load_sync(model))
lens = panda.PerspectiveLens()
lens.set_aspect_ratio(view["size"][0] / view["size"][1])
lens.set_min_fov(view["fov_y"])
camera = root.attach_new_node(panda.Camera("camera", lens))
camera.set_pos(panda.LPoint3(*view["eye"]))
camera.look_at(root, panda.LPoint3(*view["target"]), panda.LVector3(0.0, 1.0, 0.0))
sun = camera.attach_new_node(panda.DirectionalLight("sun"))
root.set_light(sun)
buffer.make_display_region().set_camera(camera)
engine.render_frame()
texture.write(panda.Filename.from_os_specific(view["picture"]))
