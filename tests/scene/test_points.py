"""Points stand in scenes as meshes do: checked, lit, shadowed, in every output."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest

import rasterjit as rj

SIZE = 160, 120
CAMERA = rj.PerspectiveCamera((0, 1, 6), (0, 0, 0), (0, 1, 0), 45.0, 0.5, 50.0)
UNLIT = rj.Material("unlit")
OUTPUTS = (
    "color", "linear", "depth", "distance", "face_id", "object_id", "barycentric", "normal",
    "geometric_normal", "normal_camera", "position", "position_camera", "object_position", "nocs",
    "coverage",
)  # fmt: skip
SHAPES = ("square", "disc", "sphere")


def cloud(count=80, **options):
    """Return some points in a ball, each of a colour of its own."""
    rng = np.random.default_rng(2)
    options = {"colors": rng.random((count, 3))} | options
    return rj.Points(rng.normal(0.0, 0.8, (count, 3)), **options)


def of_shape(shape, **options):
    """Return a cloud of sizes in scene units."""
    return cloud(shape=shape, unit="world", size=0.4, **options)


def draw(what, outputs="color", camera=CAMERA, size=SIZE, **options):
    """Render one output, or several."""
    options = {"threads": 1} | options
    frame = rj.render(what, camera, size=size, outputs=outputs, **options)
    return getattr(frame, outputs) if isinstance(outputs, str) else frame


def behind_glass(*meshes):
    """Return a scene of some things with a pane before them."""
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    corners = [(-2, -2, 1), (2, -2, 1), (2, 2, 1), (-2, 2, 1)]
    glass = rj.Material("unlit", base_color=(0.2, 0.4, 1.0, 0.5), alpha_mode="blend")
    scene.add(rj.Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=glass))
    return scene


# --- what they are --------------------------------------------------------------------------------


def test_points_keep_what_they_are_given():
    points = cloud(5, size=[1, 2, 3, 4, 5], shape="disc")
    assert repr(points) == "Points(5 discs)"
    assert (len(points), points.unit, points.shape) == (5, "pixel", "disc")
    assert points.sizes.tolist() == [1, 2, 3, 4, 5]
    assert points.colors.shape == (5, 4)
    assert points.faces.tolist() == [[n] * 3 for n in range(5)]
    for again in (copy.deepcopy(points), pickle.loads(pickle.dumps(points))):
        assert (again.unit, again.shape, again.sizes.tolist()) == ("pixel", "disc", [1, 2, 3, 4, 5])
        assert not again.sizes.flags.writeable
    assert points.split_creases() is points


def test_bounds_reach_around_sizes_in_scene_units_alone():
    positions = [(0, 0, 0), (1, 2, 3)]
    low, high = rj.Points(positions, size=9.0).bounds()
    assert (low.tolist(), high.tolist()) == ([0, 0, 0], [1, 2, 3])
    low, high = rj.Points(positions, size=[1, 4], unit="world").bounds()
    assert (low.tolist(), high.tolist()) == ([-1, -0.5, -0.5], [3, 4, 5])
    dropped = rj.Points([*positions, (np.nan, 9, 9)], unit="world", size=1.0, on_invalid="drop")
    assert dropped.bounds()[1].tolist() == [1.5, 2.5, 3.5]
    with pytest.raises(ValueError, match="bounds"):
        rj.Points([(np.nan, 0, 0)], on_invalid="drop").bounds()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": 0.0}, r"size must be finite and above 0, got 0\.0"),
        ({"size": [1.0, -1.0, 1.0]}, "size must be finite and above 0, got 1 of 3"),
        ({"size": np.nan}, "size must be finite"),
        ({"size": [1.0, 2.0]}, r"size must be one number or have shape \(3,\), got \(2,\)"),
        ({"size": 5000}, "size must be at most 4096 pixels"),
        ({"size": "large"}, "size must be a number"),
        ({"shape": "star"}, "shape must be"),
        ({"unit": "mm"}, "unit must be"),
        ({"shape": "sphere"}, "unit must be 'world' where shape is 'sphere'"),
        ({"shape": "sphere", "unit": "world", "normals": np.ones((3, 3))}, "normals must be None"),
        ({"colors": np.ones((2, 3))}, "colors"),
        ({"colors": "rde"}, "colors must be '#rgb'.*did you mean 'red'"),
        ({"colors": (255, 0, 0)}, r"colors must lie in 0\.\.1, got 255"),
        ({"colors": [1.0] * 5}, r"colors must have shape \(n, 3\) or \(n, 4\), got \(5,\)"),
        ({"colors": [(1.0, 0, 0), (1.0, 0), (1, 0, 0)]}, "colors must be an array of numbers"),
        ({"colors": ["red", "red", "red"]}, "colors must hold numbers"),
        ({"normals": np.ones((2, 3))}, "normals"),
        ({"scalars": [1, 2]}, "scalars"),
        ({"material": rj.Material("gouraud")}, "material must be shaded"),
        ({"material": rj.Material("flat")}, "material must be shaded"),
        ({"material": "red"}, "material must be a Material"),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        rj.Points(np.zeros((3, 3)), **options)


@pytest.mark.parametrize("positions", [np.empty((0, 3)), np.zeros((3, 2)), np.zeros(3), "abc"])
def test_positions_that_are_none_are_refused(positions):
    with pytest.raises(ValueError, match="positions"):
        rj.Points(positions)


# --- in every output ------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
def test_outputs_agree_with_each_other(shape):
    points = of_shape(shape)
    frame = draw(points, OUTPUTS)
    seen = frame.face_id >= 0
    assert seen.sum() > 2000
    centres = points.vertices[frame.face_id[seen]]
    # Positions lie at the depth and the distance that are told.
    view = CAMERA.view_matrix()
    along = -(frame.position[seen] @ view[2, :3] + view[2, 3])
    np.testing.assert_allclose(along, frame.depth[seen], rtol=2e-6)
    ways = frame.position[seen] - CAMERA.eye_position()
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), frame.distance[seen], rtol=1e-6)
    np.testing.assert_allclose(frame.object_position[seen], frame.position[seen], atol=1e-6)
    in_camera = frame.position[seen] @ view[:3, :3].T + view[:3, 3]
    np.testing.assert_allclose(frame.position_camera[seen], in_camera, atol=1e-5)
    np.testing.assert_array_equal(frame.coverage, seen)
    assert np.isnan(frame.position[~seen]).all()
    assert (frame.barycentric == 0).all()
    assert (frame.normal[~seen] == 0).all()
    np.testing.assert_array_equal(frame.normal, frame.geometric_normal)
    low, high = points.bounds()
    scaled = 0.5 + (frame.position[seen] - (low + high) / 2) / np.linalg.norm(high - low)
    np.testing.assert_allclose(frame.nocs[seen], scaled, atol=1e-6)
    if shape == "sphere":
        np.testing.assert_allclose(
            frame.position[seen], centres + 0.2 * frame.normal[seen], atol=2e-6
        )
    else:
        np.testing.assert_allclose(frame.position[seen], centres, atol=1e-6)
        toward = -(centres - CAMERA.eye_position())
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        np.testing.assert_allclose(frame.normal[seen], toward, atol=1e-6)
        # Unlit: the colour that was given.
        np.testing.assert_array_equal(
            frame.linear[seen, :3], points.colors[frame.face_id[seen], :3]
        )


def test_spheres_are_drawn_where_rays_meet_them_nearest_first():
    points = of_shape("sphere")
    frame = draw(points, ("depth", "face_id"))
    view, projection = CAMERA.view_matrix(), CAMERA.projection_matrix(SIZE)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    x = ((2 * columns + 1) / SIZE[0] - 1) / projection[0, 0]
    y = (1 - (2 * rows + 1) / SIZE[1]) / projection[1, 1]
    ways = np.stack([x, y, -np.ones_like(x)], axis=-1)
    centres = points.vertices @ view[:3, :3].T + view[:3, 3]
    along = ways @ centres.T
    squares = (ways**2).sum(axis=-1)[..., np.newaxis]
    left = along**2 - squares * ((centres**2).sum(axis=1) - 0.04)
    depths = np.where(left >= 0, (along - np.sqrt(np.maximum(left, 0))) / squares, np.inf)
    sure = (np.abs(left) > 1e-9).all(axis=-1)
    nearest = depths.min(axis=-1)
    assert (np.isfinite(nearest) == (frame.face_id >= 0))[sure].all()
    both = sure & np.isfinite(nearest)
    np.testing.assert_allclose(frame.depth[both], nearest[both], rtol=1e-6)
    # Where two spheres meet either may be seen.
    other = np.sort(depths, axis=-1)[..., 1]
    clear = both & (other > nearest + 1e-5)
    np.testing.assert_array_equal(frame.face_id[clear], depths.argmin(axis=-1)[clear])


@pytest.mark.parametrize("shape", SHAPES)
def test_scalars_and_attributes_are_those_of_the_point(shape):
    values = np.linspace(-3, 9, 80)
    points = of_shape(
        shape, colors=None, scalars=values, colormap="plasma", material=UNLIT,
        attributes={"weight": np.stack([values, values**2], axis=1)},
    )  # fmt: skip
    frame = draw(points, ("face_id", "scalar", "attribute:weight", "linear"))
    seen = frame.face_id >= 0
    own = values[frame.face_id[seen]].astype(np.float32)
    np.testing.assert_array_equal(frame.scalar[seen], own)
    np.testing.assert_array_equal(frame.attribute("weight")[seen][:, 0], own)
    assert np.isnan(frame.scalar[~seen]).all()
    expected = points.field.colors()[frame.face_id[seen]]
    np.testing.assert_allclose(frame.linear[seen], expected, atol=1e-6)


@pytest.mark.parametrize("normals", [None, np.tile([0.0, 0.0, 1.0], (80, 1))])
def test_points_are_shown_by_an_attribute(normals):
    values = np.linspace(-3, 9, 80)
    heat = {"heat": values[:, np.newaxis]}
    points = cloud(colors=None, attributes=heat, normals=normals)
    expected = cloud(colors=None, scalars=np.float32(values), normals=normals, colormap="plasma")
    wanted = draw(expected, ("color", "scalar"))
    for scalars in ("heat", np.float32(values), points.attributes["heat"]):
        shown = points.with_scalars(scalars, "plasma")
        assert isinstance(shown, rj.Points)
        assert shown.field.of_faces
        assert np.array_equal(shown.colors, expected.colors)
        frame = draw(shown, ("color", "scalar"))
        np.testing.assert_array_equal(frame.color, wanted.color)
        np.testing.assert_array_equal(frame.scalar, wanted.scalar)
    assert points.field is None
    assert points.colors is None
    assert shown.without_colors().colors is None
    with pytest.raises(ValueError, match=r"scalars must have shape \(80,\), got shape \(2,\)"):
        points.with_scalars([1, 2])
    for scalars in ("heat", values):
        with pytest.raises(
            ValueError, match="contours must be None for points, which have no slopes; got 3"
        ):
            points.with_scalars(scalars, contours=3)


@pytest.mark.parametrize(
    ("color", "linear"),
    [
        ("red", (1, 0, 0, 1)), ("#ff000080", (1, 0, 0, np.float32(128) / np.float32(255))),
        ((0.25, 0.5, 1.0), (0.25, 0.5, 1, 1)), ([0.25, 0.5, 1.0, 0.5], (0.25, 0.5, 1, 0.5)),
        (np.array([255, 0, 255], np.uint8), (1, 0, 1, 1)),
        (np.array([255, 0, 255, 0], np.uint8), (1, 0, 1, 0)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("count", [2, 3, 4])
def test_one_colour_is_that_of_all(color, linear, count):
    places = np.arange(3.0 * count).reshape(count, 3)
    points, lines = rj.Points(places, colors=color), rj.Lines(places, colors=color)
    np.testing.assert_array_equal(points.colors, np.tile(np.float32(linear), (count, 1)))
    np.testing.assert_array_equal(lines.face_colors, np.tile(np.float32(linear), (count - 1, 1)))
    assert points.material == lines.material == UNLIT
    with pytest.raises(ValueError, match="read-only"):
        points.colors[0] = 0.0


def test_points_of_one_colour_show_it():
    every = np.tile((0.25, 0.5, 1.0), (80, 1))
    expected = draw(cloud(colors=every), "linear")
    np.testing.assert_array_equal(draw(cloud(colors=(0.25, 0.5, 1.0)), "linear"), expected)
    shown = draw(rj.Lines([(-1, 0, 0), (1, 0, 0)], colors="red", width=5.0), "color")
    assert shown[SIZE[1] // 2, SIZE[0] // 2].tolist() == [255, 0, 0, 255]


def test_scalars_keep_a_material_that_was_given():
    material = rj.Material("unlit", base_color=(1.0, 0.5, 0.25))
    points = cloud(colors=None, material=material)
    assert points.with_scalars(np.arange(80.0)).material == material


def test_motion_is_that_of_centres():
    points = of_shape("sphere")
    before = rj.PreviousView(points, CAMERA)
    still = draw(points, ("motion", "face_id"), previous=before)
    seen = still.face_id >= 0
    assert (still.motion[seen] == 0).all()
    moved = rj.Scene()
    moved.add(points, transform=rj.transforms.translate((0.5, 0, 0)))
    frame = draw(moved, ("motion", "face_id"), previous=before)
    assert (frame.motion[frame.face_id >= 0][:, 0] > 3).all()
    assert np.abs(frame.motion[frame.face_id >= 0][:, 1]).max() < 1e-4


# --- light ----------------------------------------------------------------------------------------


def test_spheres_are_shaded_as_fine_meshes_of_them():
    material = rj.Material("phong", base_color=(0.8, 0.4, 0.2), specular=0.3)
    light = rj.DirectionalLight(direction=(-1, -1, -1), intensity=2.0)
    angles = np.linspace(0, np.pi, 129)
    around = np.linspace(0, 2 * np.pi, 257)
    up, turn = np.meshgrid(angles, around, indexing="ij")
    ball = np.stack([np.sin(up) * np.cos(turn), np.cos(up), np.sin(up) * np.sin(turn)], axis=-1)
    numbers = np.arange(ball[..., 0].size).reshape(up.shape)
    a, b = numbers[:-1, :-1].ravel(), numbers[:-1, 1:].ravel()
    c, d = numbers[1:, 1:].ravel(), numbers[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    flat = ball.reshape(-1, 3)
    pictures = []
    for mesh in (
        rj.Mesh(flat, faces, normals=flat, material=material),
        rj.Points([(0, 0, 0)], size=2.0, unit="world", shape="sphere", material=material),
    ):
        scene = rj.Scene()
        scene.add(mesh)
        scene.lights = [light, rj.AmbientLight(intensity=0.2)]
        pictures.append(draw(scene, ("linear", "face_id")))
    both = (pictures[0].face_id >= 0) & (pictures[1].face_id >= 0)
    assert both.sum() > 1000
    assert (both != (pictures[1].face_id >= 0)).sum() < 60
    difference = np.abs(pictures[0].linear - pictures[1].linear)[both]
    assert difference.max() < 0.02


def test_points_with_normals_are_lit_on_the_side_that_is_seen():
    normal = np.array([0.6, 0.0, 0.8])
    frames = [
        draw(rj.Points([(0, 0, 0)], size=9, normals=[way], shape=shape), ("color", "normal"))
        for way in (normal, -5 * normal)
        for shape in ("square", "disc")
    ]
    for frame in frames:
        seen = frame.normal.any(axis=-1)
        np.testing.assert_allclose(frame.normal[seen], np.tile(normal, (seen.sum(), 1)), atol=1e-6)
        np.testing.assert_array_equal(frame.color[seen][0], frames[0].color[seen][0])
    lit = rj.Points([(0, 0, 0)], size=9, material=rj.Material("phong"))
    facing = draw(lit, ("color", "normal"))
    assert facing.normal[60, 80] @ np.array([0, 1, 6]) / 37**0.5 == pytest.approx(1.0, abs=1e-4)
    assert facing.color[60, 80, 0] >= frames[0].color[60, 80, 0]


@pytest.mark.parametrize("filter", ["hard", "pcf", "soft"])
def test_points_in_scene_units_cast_shadows_and_those_in_pixels_do_not(filter):
    floor = rj.Mesh(
        [(-3, -1, -3), (-3, -1, 3), (3, -1, 3), (3, -1, -3)], [[0, 1, 2], [0, 2, 3]],
        material=rj.Material("phong", base_color="gray", specular=0.0),
    )  # fmt: skip
    camera = rj.PerspectiveCamera((0, 6, 4), (0, -1, 0), (0, 1, 0), 45.0, 0.5, 50.0)

    soft = 0.01 if filter == "soft" else None

    def shadowed(points):
        dark = []
        for shadow in (rj.Shadow(filter=filter, light_size=soft), None):
            scene = rj.Scene()
            scene.add(floor)
            scene.add(points)
            scene.lights = [rj.DirectionalLight((0, -1, 0), intensity=1.0, shadow=shadow)]
            dark.append(draw(scene, ("linear", "object_id"), camera))
        on_floor = dark[0].object_id == 0
        return ((dark[0].linear[..., 0] < 0.9 * dark[1].linear[..., 0]) & on_floor).sum()

    assert shadowed(rj.Points([(1, 0.5, 0)], size=12.0)) == 0
    counts = [
        shadowed(rj.Points([(1, 0.5, 0)], size=1.0, unit="world", shape=shape, material=UNLIT))
        for shape in SHAPES
    ]
    square, disc, sphere = counts
    assert disc > 100
    assert square == pytest.approx(disc * 4 / np.pi, rel=0.15)
    assert sphere == pytest.approx(disc, rel=0.15)


def test_spheres_do_not_shade_themselves_on_the_lit_side():
    scene = rj.Scene()
    scene.add(rj.Points([(0, 0, 0)], size=3.0, unit="world", shape="sphere"))
    frames = []
    for shadow in (rj.Shadow(), None):
        scene.lights = [rj.DirectionalLight((0.3, -1, -0.8), intensity=1.0, shadow=shadow)]
        frames.append(draw(scene, ("linear", "normal")))
    facing = frames[0].normal @ -np.array([0.3, -1, -0.8]) / 1.73**0.5 > 0.2
    assert facing.sum() > 500
    np.testing.assert_allclose(frames[0].linear[facing], frames[1].linear[facing], rtol=0.05)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("effect", ["fog", "ambient_occlusion", "outline", "environment"])
def test_effects_act_on_points(shape, effect):
    scene = rj.Scene()
    scene.add(of_shape(shape, material=rj.Material("pbr") if effect == "environment" else None))
    plain = draw(scene)
    sky = np.full((8, 16, 3), 0.5, np.float32)
    value = {
        "fog": rj.Fog("white", mode="linear", start=1.0, end=9.0), "outline": rj.Outline(),
        "ambient_occlusion": rj.AmbientOcclusion(), "environment": rj.Environment(sky),
    }[effect]  # fmt: skip
    setattr(scene, effect, value)
    if effect == "ambient_occlusion" and shape != "sphere":
        # It dims light, of which unlit things have none.
        assert (draw(scene) == plain).all()
    else:
        assert (draw(scene) != plain).any()


# --- several things in a pixel --------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("samples", [1, 4, 8, "area", 64])
def test_samples_smooth_every_shape(shape, samples):
    frame = draw(
        of_shape(shape), ("color", "coverage", "face_id"), quality=rj.Quality(samples=samples)
    )
    one = draw(of_shape(shape), ("color", "face_id"))
    np.testing.assert_array_equal(frame.face_id, one.face_id)
    assert (np.unique(frame.coverage).size > 2) == (samples != 1)
    assert np.abs(frame.coverage.mean() - (one.face_id >= 0).mean()) < 0.01
    assert np.abs(frame.color.mean() - one.color.mean()) < 2.0
    told = str(frame.plan)
    assert ("discs or spheres" in told) == (shape != "square" and samples in (8, "area"))


@pytest.mark.parametrize("shape", SHAPES)
def test_points_are_seen_through_glass(shape):
    points = of_shape(shape, material=UNLIT)
    plain, behind = draw(points, ("linear", "face_id")), draw(behind_glass(points), "linear")
    seen = plain.face_id >= 0
    inside = np.zeros_like(seen)
    inside[30:90, 50:110] = True
    inside &= seen & (draw(points, "position")[..., 2] < 0.9)
    assert inside.sum() > 300
    mixed = 0.5 * np.array([0.2, 0.4, 1.0]) + 0.5 * plain.linear[inside][:, :3]
    np.testing.assert_allclose(behind[inside][:, :3], mixed, atol=1e-5)


def test_squares_may_be_seen_through_and_others_not():
    glass = rj.Material("unlit", alpha_mode="blend")
    colors = np.full((2, 4), (1.0, 0.0, 0.0, 0.5))
    places = [(0, 0, 0), (0, 0, 1)]
    frame = draw(rj.Points(places, size=9, colors=colors, material=glass), "linear")
    assert frame[60, 80, 0] == pytest.approx(1.0)
    assert frame[60, 80, 1] == pytest.approx(0.25)
    for shape in ("disc", "sphere"):
        clear = rj.Points(places, colors=colors, material=glass, shape=shape, unit="world", size=1)
        with pytest.raises(ValueError, match=r"material of .* must be opaque, for its points are"):
            draw(clear)
        whole = rj.Points(places, material=glass, shape=shape, unit="world", size=1)
        assert (draw(whole, "face_id") >= 0).any()
    masked = rj.Points(places, material=rj.Material("unlit", alpha_mode="mask"))
    with pytest.raises(ValueError, match="points have no holes"):
        draw(masked)


# --- other ways of drawing ------------------------------------------------------------------------


@pytest.mark.parametrize("depth_format", ["float32", "float64", "unorm16", "unorm24"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_formats_of_depth_and_precision(depth_format, precision):
    scene = rj.Scene()
    for shape in SHAPES:
        scene.add(of_shape(shape))
    scene.outline = rj.Outline()
    quality = rj.Quality(depth_format=depth_format, precision=precision)
    frame, usual = (draw(scene, ("face_id", "depth", "color"), quality=q) for q in (quality, None))
    assert (frame.face_id != usual.face_id).mean() < 0.01
    same = (frame.face_id == usual.face_id) & (usual.face_id >= 0)
    np.testing.assert_allclose(frame.depth[same], usual.depth[same], rtol=0.01)
    assert (frame.color != usual.color).any(axis=-1).mean() < 0.02


def test_a_lens_keeps_sizes_in_pixels():
    point = rj.Points([(0, 0, 0)], size=9.0)
    lens = rj.PinholeDistortion(k1=0.05)
    frame = rj.render(point, CAMERA, size=SIZE, outputs=("face_id",), lens=lens, threads=1)
    assert (frame.face_id == 0).sum() == pytest.approx(81, abs=18)


def test_points_beside_the_picture_reach_into_it():
    camera = rj.PerspectiveCamera((0, 0, 5), (0, 0, 0), (0, 1, 0), 60.0, 0.5, 50.0)
    edge = 5 * np.tan(np.radians(30)) * SIZE[0] / SIZE[1]
    near = rj.Points([(edge * 1.05, 0, 0)], size=40.0, colors=[(1.0, 0.0, 0.0)])
    frame = draw(near, ("color", "face_id"), camera)
    seen = frame.face_id == 0
    assert seen.any()
    assert (frame.color[seen] == (255, 0, 0, 255)).all()
    away = rj.Points([(edge * 3, 0, 0)], size=40.0)
    assert "1 object outside the view" in str(rj.explain(away, camera, size=SIZE))


def test_explanations_tell_of_points():
    scene = rj.Scene()
    for n, shape in enumerate(SHAPES):
        scene.add(of_shape(shape), transform=rj.transforms.translate((n - 1.0, 0, 0)))
    assert "points" in str(rj.explain(scene, CAMERA, size=SIZE))
    assert "points" not in [
        line.split()[0] for line in str(rj.explain(rj.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)],
                                                            [[0, 1, 2]]))).splitlines()
    ]  # fmt: skip
    frame = draw(scene, ("color", "linear", "face_id", "depth"))
    for number in (10, 90, 170):
        rows, columns = np.nonzero(frame.face_id // 80 == number // 80)
        row, column = int(rows[len(rows) // 2]), int(columns[len(rows) // 2])
        told = rj.explain_pixel(scene, CAMERA, SIZE, column, row)
        assert told.faces[0].face == frame.face_id[row, column]
        assert told.faces[0].depth == frame.depth[row, column]
        np.testing.assert_array_equal(told.color, frame.color[row, column])


@pytest.mark.parametrize("shape", ["disc", "sphere"])
def test_what_needs_several_faces_of_a_pixel_is_refused(shape):
    with pytest.raises(ValueError, match="discs or spheres"):
        rj.render_layers(of_shape(shape), CAMERA, k=2, size=SIZE, outputs=("depth",))
    with pytest.raises(ValueError, match="diagnose must be False"):
        draw(of_shape(shape), diagnose=True)


def test_squares_lie_in_layers_one_behind_the_other():
    points = rj.Points([(0, 0, 0), (0, 0, 1), (0, 0, -1)], size=5.0)
    camera = rj.PerspectiveCamera((0, 0, 6), (0, 0, 0), (0, 1, 0), 45.0, 0.5, 50.0)
    frame = rj.render_layers(points, camera, k=3, size=SIZE, outputs=("face_id",), threads=1)
    assert frame.face_id[:, 60, 80].tolist() == [1, 0, 2]
    counted = draw(points, ("face_id",), camera, diagnose=True)
    assert counted.diagnostics.visible == 1
    assert counted.diagnostics.hidden == 2


def test_a_scene_reaches_around_sizes_in_scene_units():
    positions = [(0.0, 0.0, 0.0), (1.0, 2.0, 3.0)]
    scene = rj.Scene()
    scene.add(rj.Points(positions, size=[1, 4], unit="world", shape="sphere"))
    low, high = scene.bounds()
    assert (low.tolist(), high.tolist()) == ([-1, -0.5, -0.5], [3, 4, 5])
    center, radius = scene.bounding_sphere()
    assert center.tolist() == [1.0, 1.75, 2.25]
    assert radius == pytest.approx(np.sqrt(1 + 1.75**2 + 2.25**2) + 0.5)
    # The transform scales sizes as much as it does most.
    scene = rj.Scene()
    scene.add(rj.Points([(1, 1, 1)], size=2.0, unit="world"), rj.transforms.scale((1, -3, 0.5)))
    low, high = scene.bounds()
    assert (low.tolist(), high.tolist()) == ([-2, -6, -2.5], [4, 0, 3.5])
    assert scene.bounding_sphere()[1] == pytest.approx(3.0)
    # Of lines, at each point the widest segment.
    scene = rj.Scene()
    scene.add(rj.Lines([*positions, (2, 2, 3)], width=[2, 6], unit="world"))
    low, high = scene.bounds()
    assert (low.tolist(), high.tolist()) == ([-2, -1, -1], [5, 5, 6])
    scene = rj.Scene()
    scene.add(rj.Points(positions, size=9.0))
    assert scene.bounding_sphere()[1] == pytest.approx(np.sqrt(14) / 2)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_fitted_cameras_cut_no_spheres(projection):
    positions = np.random.default_rng(0).normal(size=(50, 3))
    for places, size in ((positions, 2.0), ([[0.0, 0.0, 0.0]], 5.0)):
        scene = rj.Scene()
        scene.add(rj.Points(places, size=size, unit="world", shape="sphere"))
        camera = rj.fit_camera(scene, projection=projection)
        frame = rj.render(scene, camera, size=(100, 100), outputs=("face_id", "depth"))
        wide = dataclasses.replace(camera, near=camera.near / 100, far=camera.far * 100)
        again = rj.render(scene, wide, size=(100, 100), outputs=("face_id",))
        assert (frame.face_id == again.face_id).all()
        drawn = frame.face_id >= 0
        assert drawn.mean() > 0.3
        border = drawn.copy()
        border[1:-1, 1:-1] = False
        assert not border.any()


def test_points_name_their_positions_and_are_never_closed():
    points = cloud()
    assert points.positions is points.vertices
    assert not points.is_closed()
