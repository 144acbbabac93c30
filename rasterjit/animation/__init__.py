"""
Moving pictures: cameras that go around, key frames, morphs, and files that are written as they go.

``frames(..., animation="walk")`` plays what a glTF file brought. A *track* is a function of time:
`CameraTrack`, `TransformTrack` and `MorphTrack` go from key to key, `turntable` goes around.
`frames` renders one frame for each time, and `save` writes them as they come, so that an animation
of any length takes the memory of one frame:

>>> from rasterjit import animation
>>> scene = rj.load("models/teapot.obj")
>>> times = [number / 48 for number in range(48)]
>>> with rj.Renderer((320, 240)) as renderer:
...     turn = animation.turntable(scene, aspect=320 / 240)
...     animation.save(animation.frames(renderer, scene, times, camera=turn), "turn.gif", fps=24)
"""

from rasterjit.animation.render_animation import frames, save
from rasterjit.animation.tracks import CameraTrack, MorphTrack, TransformTrack, turntable

__all__ = ["CameraTrack", "MorphTrack", "TransformTrack", "frames", "save", "turntable"]
