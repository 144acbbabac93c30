"""
Nothing crashes: whatever number, index, matrix, size or byte is given, there is a clear error or a
frame whose invariants hold.

Numba's bounds checks (``NUMBA_BOUNDSCHECK=1``) turn a read or write outside an array into an
``IndexError``, which fails these tests; without them such an access may go unseen.
"""

from __future__ import annotations

import contextlib
import faulthandler
import inspect
import math
import re
import warnings
from pathlib import Path

import frames
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.outputs.output_table import OUTPUTS
from rasterjit.scene.quality import LEVELS
from rasterjit.scene.texture import FILTERS, WRAPS

pytestmark = pytest.mark.usefixtures("hang_is_a_failure")

SECONDS_UNTIL_IT_HANGS = 540
"""Far more than any test here takes, plain Python's share included."""

EXTREMES = [
    0.0, -0.0, 5e-324, -5e-324, 2.0**-1022, 1e-308, -1e-160, 1e-30, 0.5, 1.0, -1.0, 2.0, 45.0,
    180.0, 1e6, 2.0**31, -(2.0**31), 2.0**53, 1e30, 3.5e38, 1e150, 1.1e150, -1e155, 1e308, -1e308,
    1.7976931348623157e308, math.nan, math.inf, -math.inf,
]  # fmt: skip
STRANGE = [None, "1", "", b"x", True, [], [[]], {}, 2**70, -(2**70), 1j, object()]

wild = st.one_of(st.sampled_from(EXTREMES), st.floats())
tame = st.floats(-3.0, 3.0, width=16)
usually_tame = st.one_of(tame, tame, tame, tame, tame, tame, tame, wild)
anything = st.one_of(wild, st.sampled_from(STRANGE), st.lists(wild, max_size=5), st.integers())
whole = st.one_of(st.integers(-20, 40), st.integers(), st.sampled_from([*EXTREMES, *STRANGE]))
names = st.one_of(st.text(max_size=4), st.sampled_from(["back", "front", "only", "flat", "phong"]))

SIZES = [(1, 1), (7, 5), (16, 9), (33, 2)]


def few(count):
    return settings(max_examples=count, suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module")
def hang_is_a_failure():
    faulthandler.dump_traceback_later(SECONDS_UNTIL_IT_HANGS, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


def rows(count, width, values=usually_tame):
    return st.lists(
        st.lists(values, min_size=width, max_size=width), min_size=count, max_size=count
    ).map(lambda value: np.array(value, np.float64))


def vectors(values=wild):
    return st.one_of(st.tuples(values, values, values), st.sampled_from(STRANGE), st.lists(wild))


def attempt(function, *arguments, **named):
    """Return what a call gives, or None if it refuses with a message that names an argument."""
    try:
        return function(*arguments, **named)
    except ValueError as error:
        message = str(error)
        known = list(inspect.signature(function).parameters) + list(named)
        assert message
        assert message.isprintable() or "\n" in message
        assert any(name.rstrip("s") in message for name in known), (function, message)
        return None


def check_ground_truth(frame):
    """Hold the invariants of the other buffers, where nothing has moved."""
    seen = frame.face_id >= 0
    assert not np.isnan(frame.distance).any()
    assert np.isposinf(frame.distance[~seen]).all()
    assert (frame.distance[seen] >= 0.0).all()
    assert ((frame.nocs[seen] >= 0.0) & (frame.nocs[seen] <= 1.0)).all()
    for name in ("nocs", "object_position", "motion"):
        assert np.isnan(getattr(frame, name)[~seen]).all()
    assert not np.isnan(frame.object_position[seen]).any()
    assert not np.isnan(frame.geometric_normal).any()
    for name in ("material_id", "instance_id"):
        assert ((getattr(frame, name) >= 0) == seen).all()
    assert (frame.coverage == seen).all()
    assert not frame.motion_visible[~seen].any()
    moved = frame.motion[seen]
    # What is too large for the matrices to place moves by nothing that is a number.
    assert ((moved == 0.0) | np.isnan(moved)).all()


def check_frame(frame, faces, objects, size):
    """Hold the invariants of every output that a frame has."""
    width, height = size
    face_id = frame.face_id
    seen = face_id >= 0
    assert face_id.shape == (height, width)
    assert face_id.min() >= -1
    assert face_id.max() < faces
    depth, weights = frame.depth, frame.barycentric
    assert not np.isnan(depth).any()
    assert np.isposinf(depth[~seen]).all()
    assert ((weights >= 0.0) & (weights <= 1.0)).all()
    assert not weights[~seen].any()
    owner = frame.object_id
    assert ((owner >= 0) == seen).all()
    assert owner.max() < objects
    assert not np.isnan(frame.linear).any()
    assert not np.isnan(frame.normal).any()
    assert np.isnan(frame.position[~seen]).all()
    assert not np.isnan(frame.position[seen]).any()
    assert frame.color.shape == (height, width, 4)
    stats = frame.stats
    assert stats.triangles_in == faces
    parts = (stats.outside, stats.culled, stats.degenerate, stats.unsampled, stats.invalid)
    assert min(parts) >= 0
    assert sum(parts) + stats.drawn == faces


@few(60)
@given(
    vertices=st.one_of(anything, rows(4, 3, wild)),
    faces=st.one_of(
        anything, st.lists(st.lists(whole, min_size=3, max_size=3), min_size=1, max_size=3)
    ),
    colors=anything, normals=anything, uv=anything, on_invalid=names,
)  # fmt: skip
def test_mesh_takes_or_refuses_anything(vertices, faces, colors, normals, uv, on_invalid):
    attempt(rj.Mesh, vertices, faces)
    attempt(rj.Mesh, vertices, [(0, 1, 2)], on_invalid="drop")
    attempt(rj.Mesh, np.eye(3), faces)
    for name, value in (("colors", colors), ("normals", normals), ("uv", uv)):
        attempt(rj.Mesh, np.eye(3), [(0, 1, 2)], **{name: value})
    for attributes in (colors, {on_invalid: colors}, {"a": normals, "b": uv}):
        attempt(rj.Mesh, np.eye(3), [(0, 1, 2)], attributes=attributes)
    attempt(rj.rasterize(np.ones((3, 4)), [(0, 1, 2)], (3, 3)).interpolate, uv)
    attempt(rj.Mesh, np.eye(3), [(0, 1, 2)], on_invalid=on_invalid)
    attempt(rj.Mesh, np.eye(3), [(0, 1, 2)], material=normals)


@few(60)
@given(
    scalars=st.one_of(anything, st.lists(wild, min_size=3, max_size=3)),
    colors=st.one_of(anything, names), numbers=st.tuples(anything, anything, anything),
)  # fmt: skip
def test_fields_take_or_refuse_anything(scalars, colors, numbers):
    first, second, third = numbers
    attempt(rj.Colormap, colors)
    attempt(rj.Contours, first, width=second, color=third)
    given_ = np.eye(3), [(0, 1, 2)]
    for named in (
        {}, {"colormap": colors}, {"range": first}, {"range": (first, second)},
        {"nan_color": second}, {"contours": third},
    ):  # fmt: skip
        mesh = attempt(rj.Mesh, *given_, scalars=scalars, **named)
        if mesh is not None:
            frame = rj.render(mesh, size=(4, 3), outputs=("color", "scalar"))
            assert frame.scalar.shape == (3, 4)


@few(60)
@given(numbers=st.tuples(anything, anything, anything), vector=vectors(), name=names)
def test_lights_and_materials_take_or_refuse_anything(numbers, vector, name):
    a, b, c = numbers
    attempt(rj.AmbientLight, color=a, intensity=b)
    attempt(rj.DirectionalLight, direction=vector, intensity=c)
    attempt(rj.PointLight, position=vector, color=a, intensity=b)
    attempt(rj.Material, shading=name)
    attempt(rj.Material, base_color=a, specular=b)
    attempt(rj.Material, shininess=c)
    attempt(rj.Material, base_color_texture=a)
    attempt(rj.Wireframe, color=a)
    attempt(rj.Wireframe, mode=name)
    attempt(rj.Quality, a)


FIELDS = {
    rj.SpotLight: ("position", "direction", "color", "intensity", "inner_angle", "outer_angle",
                   "range", "shadow"),
    rj.PointLight: ("range", "shadow"),
    rj.DirectionalLight: ("shadow",),
    rj.Shadow: ("size", "filter", "light_size", "bias"),
    rj.Environment: ("sky", "intensity", "rotation", "background"),
    rj.Fog: ("color", "mode", "start", "end", "density", "height", "falloff"),
    rj.ToneMap: ("curve", "exposure", "white"),
    rj.AmbientOcclusion: ("radius", "strength"),
    rj.Vignette: ("strength", "start"),
    rj.EyeDome: ("strength", "radius"),
    rj.SectionPlane: ("point", "normal", "cap", "cap_color", "lines", "line_color", "line_width",
                      "hatch", "hatch_angle", "hatch_color", "hatch_width"),
    rj.Outline: ("color", "width", "edges", "crease_angle"),
    rj.Material: ("metallic", "roughness", "normal_texture", "normal_scale", "occlusion_strength",
                  "emissive", "alpha_mode", "alpha_cutoff", "double_sided",
                  "casts_shadow"),
    rj.Texture: ("color_space", "anisotropy", "offset", "rotation", "scale"),
    rj.Quality: tuple(LEVELS),
}  # fmt: skip
"""What effects are asked for with."""

NEEDED = {
    rj.PointLight: {"position": (0, 0, 0)},
    rj.SectionPlane: {"point": (0, 0, 0), "normal": (0, 0, 1)},
    rj.SpotLight: {"position": (0, 0, 0)},
    rj.Environment: {"sky": [[[1.0, 1.0, 1.0]] * 2]},
    rj.Texture: {"image": [[0.5]]},
}


@few(200)
@given(kind=st.sampled_from(list(FIELDS)), data=st.data())
def test_effects_take_or_refuse_anything(kind, data):
    fields = data.draw(st.sets(st.sampled_from(FIELDS[kind]), min_size=1, max_size=3))
    values = {name: data.draw(st.one_of(anything, names, vectors()), name) for name in fields}
    attempt(kind, **{**NEEDED.get(kind, {}), **values})


@few(30)
@given(value=st.one_of(anything, names), field=st.sampled_from(
    ["environment", "fog", "tone_map", "ambient_occlusion", "outline", "vignette",
     "eye_dome", "lights"]
))  # fmt: skip
def test_a_scene_takes_no_effect_that_is_none(value, field):
    scene = rj.Scene()
    scene.add(ball)
    is_none = value in ([], ()) if field == "lights" else value is None
    refuses = pytest.raises(ValueError, match=rf"scene\.{field}")
    with contextlib.nullcontext() if is_none else refuses:
        setattr(scene, field, value)
        assert rj.explain(scene, size=(4, 3))


@few(30)
@given(
    image=st.one_of(anything, rows(2, 3, wild), rows(3, 1)), wrap=st.one_of(anything, names),
    filter=st.one_of(anything, names), whole=whole,
    path=st.one_of(st.text(max_size=4), st.sampled_from(["~nobody", "x" * 5000, "/", 7, None])),
)  # fmt: skip
def test_textures_and_paths_take_or_refuse_anything(image, wrap, filter, whole, path):
    attempt(rj.Texture, image)
    attempt(rj.Texture, image, wrap=wrap)
    attempt(rj.Texture, [[0.5]], filter=filter)
    attempt(rj.Texture, [[[whole]]])
    attempt(rj.Texture.from_file, path)
    attempt(rj.load, path)


def use_camera(camera, size=(7, 5)):
    """Ask a camera all that the renderer asks."""
    if camera is None:
        return
    attempt(camera.view_matrix)
    attempt(camera.projection_matrix, size)
    camera.eye_position()
    c0, c1, c2 = camera.depth_coefficients()
    assert math.isfinite(c0 + c1 + c2)
    with np.errstate(all="ignore"):
        camera.view_depth(np.array([0.0, -1.0, 1.0, 1e-30, -0.25], np.float32))


@few(30)
@given(eye=vectors(), target=vectors(tame), up=vectors(), a=anything, near=anything, far=anything)
def test_cameras_take_or_refuse_anything(eye, target, up, a, near, far):
    placed = {"eye": eye, "target": target, "up": up}
    plain = {"eye": (1, 2, 3), "target": (0, 0, 0)}
    for given_ in (placed, {**plain, "near": near, "far": far}, {**plain, "up": up}):
        use_camera(attempt(rj.PerspectiveCamera, **given_))
        use_camera(attempt(rj.OrthographicCamera, **given_))
    use_camera(attempt(rj.PerspectiveCamera, **plain, fov_y=a))
    use_camera(attempt(rj.OrthographicCamera, **plain, height=a))
    attempt(rj.orbit_direction, a, near)


@few(30)
@given(view=st.one_of(rows(4, 4), anything), clip=st.one_of(rows(4, 4), anything),
       numbers=st.tuples(anything, anything, wild, wild), near=wild, far=wild)  # fmt: skip
def test_matrix_cameras_take_or_refuse_anything(view, clip, numbers, near, far):
    if isinstance(view, np.ndarray):
        view[3] = 0.0, 0.0, 0.0, 1.0
    projection = rj.transforms.perspective(60.0, 1.0, 0.1, 10.0)
    use_camera(attempt(rj.MatrixCamera, view, projection))
    use_camera(attempt(rj.MatrixCamera, np.eye(4), clip))
    use_camera(attempt(rj.MatrixCamera, view, clip))
    use_camera(attempt(rj.MatrixCamera.from_intrinsics, *numbers, (7, 5), near=near, far=far))


ball = frames.ball(2)


@few(60)
@given(direction=vectors(), up=vectors(), a=anything, b=anything, scale=wild, kind=names)
def test_fitted_cameras_take_or_refuse_anything(direction, up, a, b, scale, kind):
    scene = rj.Scene()
    attempt(rj.fit_camera, scene)
    scene.add(ball)
    use_camera(attempt(rj.fit_camera, scene, direction, up=up))
    for name, value in (("fov_y", a), ("margin", b), ("zoom", a), ("aspect", b), ("zoom", scale),
                        ("projection", kind), ("margin", scale), ("aspect", scale)):  # fmt: skip
        use_camera(attempt(rj.fit_camera, scene, **{name: value}))
    attempt(rj.fit_camera, a)
    node = attempt(scene.add, ball, np.diag([scale, scale, 1.0, 1.0]))
    if node is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            use_camera(attempt(rj.fit_camera, scene, zoom=3.0))


cameras = st.sampled_from([
    frames.looking(),
    frames.looking((0.2, 0.1, 0.3), (1.0, 0.0, -1.0), near=1e-6, fov_y=170.0),
    frames.looking(near=1e-300, far=1e300),
    frames.looking(near=1e-36, far=1e300),
    frames.looking((1e15, -1e15, 1e15), (0.0, 0.0, 0.0), fov_y=1e-12),
    rj.OrthographicCamera((1, 2, 3), (0, 0, 0), height=3.0, near=-5.0, far=9.0),
    rj.OrthographicCamera((1, 2, 3), (0, 0, 0), height=1e-200, near=-1e200, far=1e200),
    rj.MatrixCamera.from_intrinsics(9.0, 1e6, -50.0, 1e5, (7, 5), far=2.0),
    rj.MatrixCamera(np.eye(4), np.diag([1e-300, 1e300, 1.0, 1e-300])),
])  # fmt: skip


@few(120)
@given(
    vertices=rows(7, 3), faces=st.lists(st.tuples(*[st.integers(0, 6)] * 3), min_size=1,
    max_size=8), transform=st.one_of(st.none(), rows(3, 4)), camera=cameras,
    size=st.sampled_from(SIZES), bits=st.sampled_from([0, 4, 8, 12]),
    cull=st.sampled_from(["none", "back", "front"]),
    wire=st.sampled_from([None, "overlay", "only"]),
    shading=st.sampled_from(["unlit", "flat", "gouraud", "phong"]), threads=st.sampled_from([1, 3]),
    light=st.one_of(st.none(), st.tuples(usually_tame, usually_tame, usually_tame, wild)),
    specular=st.sampled_from([0.0, 0.5, 1e6]), shininess=st.sampled_from([1e-6, 5.0, 1e6]),
    picture=st.one_of(st.none(), st.tuples(
        st.sampled_from([(1, 1), (2, 3), (9, 5)]), st.sampled_from(FILTERS), st.sampled_from(WRAPS)
    )), uv=rows(7, 2, st.one_of(usually_tame, st.floats(width=32))), diagnose=st.booleans(),
)  # fmt: skip
def test_whatever_is_rendered_keeps_the_invariants(
    vertices, faces, transform, camera, size, bits, cull, wire, shading, threads, light, specular,
    shininess, picture, uv, diagnose,
):  # fmt: skip
    look = {"specular": specular, "shininess": shininess}
    if picture is not None:
        shape, kind, wrap = picture
        look["base_color_texture"] = rj.Texture(np.full(shape, 0.75), wrap=wrap, filter=kind)
    material = rj.Material(shading, "#80c0f0", **look)
    mesh = attempt(rj.Mesh, vertices, faces, uv=uv, on_invalid="drop", material=material)
    if mesh is None:
        return
    scene = rj.Scene()
    scene.add(ball)
    place = np.eye(4)
    if transform is not None:
        place[:3] = transform
    if attempt(scene.add, mesh, place) is None:
        return
    scene.wireframe = None if wire is None else rj.Wireframe("black", wire)
    if light is not None:
        lamp = attempt(rj.PointLight, light[:3], intensity=light[3])
        scene.lights = [rj.AmbientLight(intensity=1e9)] + ([] if lamp is None else [lamp])
    options = {"quality": rj.Quality(bits), "size": size}
    options |= {
        "outputs": (*frames.EVERYTHING, *frames.GROUND_TRUTH),
        "previous": rj.PreviousView(),
    }
    plan = attempt(rj.explain, scene, camera, cull=cull, **options)
    frame = attempt(
        rj.render, scene, camera, cull=cull, threads=threads, diagnose=diagnose, **options
    )
    assert (plan is None) == (frame is None)
    if frame is not None:
        assert str(plan)
        check_frame(frame, len(ball.faces) + len(faces), 2, size)
        check_ground_truth(frame)
        assert not diagnose or str(frame.diagnostics)
    else:
        # A pixel is explained where its colour can be drawn, whatever other outputs ask for.
        del options["outputs"], options["previous"]
        frame = attempt(rj.render, scene, camera, cull=cull, threads=threads, **options)
    x, y = size[0] // 2, size[1] // 2
    told = attempt(rj.explain_pixel, scene, camera, size, x, y, cull=cull, quality=rj.Quality(bits))
    assert (told is None) == (frame is None)
    if told is not None:
        assert str(told)
        assert told.color.tolist() == frame.color[y, x].tolist()


@few(60)
@given(
    distortion=st.lists(st.one_of(st.floats(-0.5, 0.5), wild), max_size=14),
    fisheye=st.lists(st.one_of(st.floats(-0.1, 0.1), wild), max_size=4), fov=wild,
    point=st.lists(wild, min_size=2, max_size=2),
)  # fmt: skip
def test_lenses_lead_somewhere_or_are_refused(distortion, fisheye, fov, point):
    lenses = [
        attempt(rj.PinholeDistortion, *distortion),
        attempt(rj.FisheyeLens, *fisheye),
        attempt(rj.FisheyeLens, *fisheye[:3], fov=fov),
        rj.Equirectangular(),
    ]
    camera = rj.PerspectiveCamera((0, 0, 4), (0, 0, 0))
    for lens in filter(None, lenses):
        attempt(rj.render, ball, camera, size=(6, 3), lens=lens)
        if not isinstance(lens, rj.Equirectangular):
            attempt(lens.distort, point)
            attempt(lens.undistort, point)


@few(60)
@given(
    k=whole, value=st.one_of(anything, names), field=st.sampled_from(["scene", "camera", "view"]),
    outputs=st.lists(st.sampled_from(OUTPUTS), max_size=3),
)  # fmt: skip
def test_layers_and_views_are_taken_or_refused(k, value, field, outputs):
    previous = value if field == "view" else rj.PreviousView(**{field: value})
    options = {"size": (4, 3), "outputs": outputs, "threads": 1}
    attempt(rj.render, ball, None, previous=previous, **options)
    k = min(k, 9) if isinstance(k, int) else k
    attempt(rj.render_layers, ball, None, k=k, previous=previous, **options)


@few(150)
@given(
    positions=st.lists(st.lists(st.one_of(usually_tame, wild), min_size=4, max_size=4), min_size=7,
    max_size=7), faces=st.lists(st.tuples(*[st.integers(0, 6)] * 3), min_size=1, max_size=9),
    size=st.sampled_from(SIZES), cull=st.sampled_from(["none", "back", "front"]),
    depth=st.sampled_from(["standard", "reversed"]), bits=st.sampled_from([0, 4, 8, 12]),
)  # fmt: skip
def test_whatever_is_rasterized_keeps_the_invariants(positions, faces, size, cull, depth, bits):
    seen = attempt(
        rj.rasterize, positions, faces, size, cull=cull, depth=depth, quality=rj.Quality(bits),
        threads=1,
    )  # fmt: skip
    covered = seen.face_id >= 0
    assert seen.face_id.shape == size[::-1]
    assert seen.face_id.min() >= -1
    assert seen.face_id.max() < len(faces)
    assert (np.abs(seen.depth[covered]) <= 1.0).all()
    assert np.isposinf(seen.depth[~covered]).all()
    assert ((seen.barycentric >= 0.0) & (seen.barycentric <= 1.0)).all()
    totals = seen.totals
    assert totals.faces_in == len(faces)
    assert totals.drawn >= len(np.unique(seen.face_id[covered]))


@few(30)
@given(positions=anything, faces=anything, size=st.one_of(anything, st.tuples(whole, whole)),
       name=names, quality=anything, threads=anything)  # fmt: skip
def test_arguments_of_a_render_are_taken_or_refused(positions, faces, size, name, quality, threads):
    clip, face = np.eye(4), [(0, 1, 2)]
    attempt(rj.rasterize, positions, face, (4, 4))
    attempt(rj.rasterize, clip, faces, (4, 4))
    small = not isinstance(size, tuple) or not all(
        isinstance(side, int | float) and 1 <= side <= 16384 for side in size
    )
    if small or math.prod(size) < 4096:
        attempt(rj.rasterize, clip, face, size)
        attempt(rj.Renderer, size)
        attempt(rj.render, ball, size=size)
        attempt(rj.explain, ball, size=size)
        if isinstance(size, tuple):
            attempt(rj.Framebuffer, *size)
    for option, value in (("cull", name), ("cull", faces), ("quality", quality)):
        attempt(rj.rasterize, clip, face, (4, 4), **{option: value})
        attempt(rj.render, ball, size=(4, 4), **{option: value})
    attempt(rj.rasterize, clip, face, (4, 4), depth=name)
    attempt(rj.render, ball, positions, size=(4, 4))
    attempt(rj.render, positions, size=(4, 4))
    attempt(rj.render, ball, size=(4, 4), outputs=positions)
    attempt(rj.render, ball, size=(4, 4), background=positions)
    if not isinstance(threads, int) or not 4 < threads <= 1024:
        attempt(rj.Renderer, (4, 4), threads=threads)


points = st.one_of(st.tuples(whole, whole), st.sampled_from(STRANGE))
whole_colors = st.one_of(
    st.tuples(*[st.integers(0, 255)] * 3), st.lists(whole, max_size=5), anything
)


@few(150)
@given(p=points, q=points, r=points, color=whole_colors, other=whole_colors, number=whole,
       depth=vectors(), name=names, curve=st.one_of(rows(3, 2, wild), rows(4, 2, tame), anything),
       ends=st.one_of(rows(3, 4, wild), anything))  # fmt: skip
def test_framebuffer_draws_or_refuses_anything(
    p, q, r, color, other, number, depth, name, curve, ends
):
    target = rj.Framebuffer(9, 6)
    before = target.color
    green = (0, 255, 0)
    attempt(target.put_pixel, number, 3, color)
    attempt(target.draw_line, p, q, green)
    attempt(target.draw_line, (1, 1), q, color, other)
    attempt(target.draw_lines, ends, other)
    attempt(target.draw_lines, [(0, 0, 5, 5)], color)
    attempt(target.draw_triangle, p, q, r, green)
    for method in ("barycentric", "scanline"):
        attempt(target.fill_triangle, p, q, r, green, method=method)
        attempt(target.fill_triangle, (0, 0), (8, 0), q, color, method=method, depth=depth)
    attempt(target.fill_triangle, p, q, r, green, method=name, edges=name)
    attempt(target.draw_circle, p, 3, green)
    attempt(target.draw_circle, (4, 3), number, green)
    attempt(target.draw_bezier, curve, green)
    attempt(target.clear, color, number)
    assert target.color is before
    assert before.shape == (6, 9, 4)
    assert not np.isnan(target.depth).any()


@few(30)
@given(a=anything, v=vectors(), u=vectors(), n=st.tuples(wild, wild, wild, wild, wild, wild),
       matrix=st.one_of(rows(4, 4, wild), rows(4, 4), anything), many=st.one_of(rows(3, 3, wild),
       anything), size=st.tuples(whole, whole))  # fmt: skip
def test_transforms_take_or_refuse_anything(a, v, u, n, matrix, many, size):
    t = rj.transforms
    for function in (
        t.translate, t.scale, t.rotate_x, t.rotate_y, t.rotate_z, t.perspective_focal,
        t.sine_cosine, t.focal_length, t.normal_matrix, t.compose,
    ):  # fmt: skip
        for value in (a, v, matrix, n[0]):
            result = refused(function, value)
            if result is not None and function is t.normal_matrix:
                assert np.isfinite(result).all()
    refused(t.rotate, v, n[0])
    refused(t.arc_tangent, n[0], n[1])
    refused(t.arc_tangent, a, n[1])
    refused(t.shear, xy=n[0], zy=a)
    refused(t.look_at, v, u, (0.0, 1.0, 0.0))
    refused(t.look_at, (0.0, 0.0, 1.0), v, u)
    refused(t.perspective, *n[:4])
    refused(t.orthographic, *n)
    refused(t.viewport, *size)
    refused(t.apply, matrix, many)
    refused(t.transform_points, np.eye(4), many)
    refused(t.compose, matrix, matrix)


def refused(function, *arguments, **named):
    """Return what a helper gives, or None: its message may name what it is part of."""
    try:
        return function(*arguments, **named)
    except ValueError:
        return None


@few(60)
@given(a=anything, v=vectors(), u=vectors(), n=st.tuples(wild, whole, whole, wild, wild),
       many=st.one_of(rows(3, 3, wild), anything))  # fmt: skip
def test_pipeline_takes_or_refuses_anything(a, v, u, n, many):
    chain = rj.ClassicPipeline()
    for step, arguments in (
        (chain.scale, (a,)), (chain.scale, (v,)), (chain.rotate, n[:3]), (chain.world_pos, (v,)),
        (chain.camera, (v, u)), (chain.perspective, n), (chain.orthographic, n),
    ):  # fmt: skip
        refused(step, *arguments)
    refused(lambda: chain.matrix)
    projected = refused(chain.project, many)
    if projected is not None:
        assert not projected.on_screen[np.isnan(projected.pixels).any(axis=1)].any()


OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0.5\nv 1 1 0\nvt 0 0\nvn 0 0 1\nf 1 2 3\nf 2/1/1 4/1/1 3/1/1\n"
OFF = b"OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 1\n3 0 1 2\n3 1 3 2\n"


def binary_stl():
    triangle = np.array([0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], "<f4").tobytes() + b"\0\0"
    return b"x" * 80 + np.array([2], "<u4").tobytes() + 2 * triangle


def file_bytes(kind):
    """Return a small whole file of a format."""
    if kind in ("ply", "glb"):
        name = "cube.ply" if kind == "ply" else "scene.glb"
        return (frames.MODELS / name).read_bytes()
    return {"obj": OBJ, "off": OFF, "stl": binary_stl()}[kind]


@pytest.mark.parametrize("kind", ["obj", "off", "stl", "ply", "glb"])
def test_whole_file_loads(kind, tmp_path):
    path = tmp_path / f"file.{kind}"
    path.write_bytes(file_bytes(kind))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        assert rj.load(path).nodes


@pytest.mark.parametrize("kind", ["obj", "off", "stl", "ply", "glb"])
def test_damaged_file_loads_or_is_refused(kind, tmp_path_factory):
    path = tmp_path_factory.mktemp("damaged") / f"file.{kind}"
    whole_file = file_bytes(kind)
    head = min(len(whole_file), 4000)

    @few(40)
    @given(
        where=st.lists(st.integers(0, head - 1), max_size=4),
        what=st.lists(st.integers(0, 255), min_size=4, max_size=4),
        cut=st.one_of(st.none(), st.integers(1, len(whole_file))),
        added=st.binary(max_size=3),
    )
    def damage(where, what, cut, added):
        data = bytearray(whole_file)
        for place, byte in zip(where, what, strict=False):
            data[place] = byte
        path.write_bytes(bytes(data[:cut]) + added)
        with warnings.catch_warnings():
            # What a file holds and is not shown is a warning by design.
            warnings.simplefilter("ignore", UserWarning)
            scene = refused(rj.load, path, on_invalid="drop")
            if scene is not None:
                frame = refused(rj.render, scene, size=(8, 6), outputs=("face_id", "color"))
                faces = sum(len(node.mesh.faces) for node in scene.nodes)
                assert frame is None or frame.face_id.max() < faces

    damage()


numbers = st.one_of(wild, st.integers(-9, 9), st.fractions(), st.sampled_from(STRANGE))
small = st.one_of(st.integers(0, 6), st.sampled_from(STRANGE[:6]), wild)


def points(count, length):
    """Return strategies of points, or of something that is none."""
    return st.one_of(st.lists(st.lists(numbers, min_size=length, max_size=length), min_size=count,
                              max_size=count), anything)  # fmt: skip


@few(150)
@given(
    triangle=points(3, 2), polygon=points(4, 4), flat=points(5, 2), point=points(1, 2),
    ws=st.one_of(st.lists(numbers, min_size=3, max_size=3), anything), value=numbers,
    size=st.one_of(st.tuples(small, small), anything), face=st.lists(small, max_size=4),
    layers=st.lists(st.one_of(st.tuples(st.lists(numbers, max_size=4), numbers), anything)),
)  # fmt: skip
def test_the_oracle_takes_or_refuses_anything(
    triangle, polygon, flat, point, ws, value, size, face, layers
):
    place = point[0] if isinstance(point, list) and point else point
    for function, arguments in (
        (rj.oracle.round_half_up, (value,)), (rj.oracle.snap, (value, 8)),
        (rj.oracle.snap, (0.5, value)),
        (rj.oracle.snap_triangle, (triangle,)), (rj.oracle.edge, (place, place, ws)),
        (rj.oracle.covers, (triangle, place)), (rj.oracle.covered_pixels, (triangle, (5, 4))),
        (rj.oracle.covered_pixels, ([(0, 0), (2, 0), (0, 2)], size)),
        (rj.oracle.affine_weights, (triangle, place)),
        (rj.oracle.perspective_weights, (triangle, ws, place)),
        (rj.oracle.clip_weights, (polygon, place, (5, 4))), (rj.oracle.interpolate, (ws, polygon)),
        (rj.oracle.depth_at, (triangle, ws, place)),
        (rj.oracle.visible_faces, ([triangle, flat], [ws, ws], (3, 2))),
        (rj.oracle.screen_position, (place, (5, 4))),
        (rj.oracle.render_faces, (polygon, [face], (3, 2))),
        (rj.oracle.view_planes, (value,)), (rj.oracle.guard_band, (size,)),
        (rj.oracle.plane_distance, (place, place)), (rj.oracle.clip_near, (polygon,)),
        (rj.oracle.clip_polygon, (polygon, polygon)), (rj.oracle.polygon_area, (flat,)),
        (rj.oracle.pixel_area, (flat, 1, 2)), (rj.oracle.line_pixels, (face, face[::-1])),
        (rj.oracle.line_colors, ((0, 0), (3, 2), ws, place)), (rj.oracle.composite, (layers,)),
    ):  # fmt: skip
        attempt(function, *arguments)


ELSEWHERE = {
    "OutputNotRequestedError": "an error that reading a frame raises",
    "Diagnostics": "what a frame is made with, checked where it is made",
    **dict.fromkeys(
        ("Frame", "FrameStats"), "what render returns; check_frame holds what they promise"
    ),
    **dict.fromkeys(("profile", "FrameProfile"), "it renders what explain plans, several times"),
    "RasterizedFaces": "what rasterize returns; its invariants are held here",
    "RenderPlan": "what explain returns; here it is printed",
    "Node": "what Scene.add returns",
    **dict.fromkeys(
        ("Lines", "Axes", "BoundingBox", "Grid", "Frustum"),
        "descriptions; tests/scene/test_wide_lines.py refuses their bad input",
    ),
    **dict.fromkeys(
        ("Arrow", "Arrows"), "descriptions; tests/scene/test_arrows.py refuses their bad input"
    ),
    **dict.fromkeys(
        ("Skin", "MorphTargets"), "descriptions; tests/scene/test_skin.py refuses their bad input"
    ),
    **dict.fromkeys(
        ("Animation", "Channel"),
        "descriptions; tests/scene/test_keyframes.py refuses their bad input",
    ),
    "Label": "a description; tests/effects/test_label.py refuses its bad input",
    "Points": "a description; tests/scene/test_points.py refuses its bad input",
    "CalibrationWarning": "a warning of the dial",
    "ViewWarning": "a warning of what is in view",
    "LoadWarning": "a warning of load; tests/hostile and tests/io hold it",
    "MeshFileError": "an error of load; tests/hostile and tests/io hold it",
    "SaveWarning": "a warning of Scene.save; tests/io hold it",
    "QualityChoice": "what the dial notes on a frame",
    "PixelExplanation": "what explain_pixel returns",
    **dict.fromkeys(
        ("length_dimension", "angle_dimension", "radius_dimension"),
        "descriptions; tests/scene/test_dimensions.py refuses their bad input",
    ),
    "explode": "it moves nodes; tests/inspect/test_exploded_view.py refuses its bad input",
    "cross_section": "it cuts as render does; its tests refuse bad input",
    "CrossSection": "what cross_section returns",
    "line_drawing": "it projects as render does; tests/hidden_lines refuse its bad input",
    "LineDrawing": "what line_drawing returns",
    "accuracy": "a module; tests/accuracy refuses its bad input",
    "LayeredFrame": "what render_layers returns",
    "PickedPixel": "what Frame.pick returns; tests/outputs/test_picking.py refuses bad input",
    "animation": "a module; tests/animation refuses its bad input",
    "dataset": "a module; tests/dataset refuses its bad input",
    "cameras": "a module; tests/io/test_cameras.py refuses its bad input",
    "masks": "a module; tests/outputs/test_masks.py refuses its bad input",
    "distributed": "a module; tests/distributed refuses its bad input",
    "render_many": "it renders as render does; tests/distributed/test_many.py refuses bad input",
    "render_batch": "it renders as render does; tests/rendering/test_batch.py refuses bad input",
    "Batch": "what render_batch returns",
    "show": "it opens windows; the viewer's tests refuse its bad input",
    "grid": "it lays pictures out; tests/outputs/test_grid.py refuses its bad input",
    "styles": "a module; what it makes goes to render; tests/styles refuses its bad input",
    **dict.fromkeys(
        ("load_cameras", "save_cameras", "CalibratedCamera"),
        "files and what they hold; tests/io/test_camera_files.py refuses bad input",
    ),
    **dict.fromkeys(("Joint", "Joints"), "parts that move; tests/scene/test_joints.py refuses it"),
    "PyTorch3DFragments": "what Frame.to_pytorch3d returns",
}
"""Public names that no test here calls, with the reason."""


def test_every_public_name_is_tried():
    tried = set(re.findall(r"\brj\.(\w+)", Path(__file__).read_text()))
    assert set(rj.__all__) - tried == set(ELSEWHERE)
