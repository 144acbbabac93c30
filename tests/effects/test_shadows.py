"""Shadows equal rays against every triangle, but for some texels at their edges, at any scale."""

from __future__ import annotations

import math
from dataclasses import replace

import naive_shadows
import numpy as np
import pytest
import trimesh

import rasterjit as rj
from rasterjit.effects import shadows as shadowing
from rasterjit.effects.shadows import filters, light_leaks, visible_cells
from rasterjit.effects.shadows import maps as shadow_maps
from rasterjit.effects.shadows import stage as shadows_stage
from rasterjit.scene import transforms as tf

SIZE = (96, 72)
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
         [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
MATT = rj.Material("phong", "white")
FLAT = rj.Material("flat", "white")


def ground(half=6.0):
    corners = [[-half, 0, -half], [half, 0, -half], [half, 0, half], [-half, 0, half]]
    return rj.Mesh(corners, [[0, 2, 1], [0, 3, 2]], material=MATT)


def box():
    return rj.Mesh(BOX, SIDES, material=FLAT)


def box_on_ground(light, scale=1.0, offset=(0.0, 0.0, 0.0)):
    """Return a unit box that stands on a plane, and a camera that sees most of it."""
    place = tf.compose(tf.translate(offset), tf.scale(scale))
    scene = rj.Scene()
    scene.add(ground(), place)
    scene.add(box(), tf.compose(place, tf.translate((-0.5, 0.0, -0.5))))
    scene.lights = [light]
    eye = np.array([2.0, 3.5, 5.0]) * scale + offset
    camera = rj.PerspectiveCamera(eye, np.array(offset, float), near=0.1 * scale, fov_y=50.0)
    return scene, camera


def without_shadow(scene):
    plain = rj.Scene()
    plain.nodes = scene.nodes
    plain.lights = [
        light if isinstance(light, rj.AmbientLight) else unshadowed(light) for light in scene.lights
    ]
    return plain


def unshadowed(light):
    return replace(light, shadow=None)


def shares(scene, camera, size=SIZE):
    """Return the share of light that reaches each pixel, NaN where there is none, and buffers."""
    outputs = ("linear", "face_id", "position")
    shown = rj.render(scene, camera, size=size, outputs=outputs, threads=1)
    bright = rj.render(without_shadow(scene), camera, size=size, outputs=outputs, threads=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = shown.linear[..., 0].astype(float) / bright.linear[..., 0]
    return np.where(shown.face_id >= 0, share, np.nan), shown


def texel_of(shadows, light, points):
    """Return how large a texel is at some points, scene units."""
    focal = shadows.maps[0, shadows_stage.FOCAL : shadows_stage.FOCAL + 2].min()
    if isinstance(light, rj.DirectionalLight):
        return np.full(len(points), 1.0 / focal)
    # On the sides of a cube as well, the depth is at most the distance.
    return np.linalg.norm(naive_shadows.toward(light, points), axis=1) / focal


def judge(scene, camera, light, shadows, reach, size=SIZE):
    """Compare a picture with rays: all of the plane's light where they say so, and none."""
    share, frame = shares(scene, camera, size)
    triangles = naive_shadows.world_triangles(scene)
    seen = np.isfinite(share)
    own = frame.face_id[seen]
    # The point on the plane of the face: positions are rounded to float32.
    points = frame.position[seen].astype(float)
    a, b, c = np.moveaxis(triangles[own], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points -= ((points - a) * normal).sum(axis=1, keepdims=True) * normal
    aside = reach * texel_of(shadows, light, points)
    dark, bright = naive_shadows.clear_shadow(points, own, triangles, light, aside)
    return share[seen], dark, bright, own


def sun(elevation, around=30.0, **shadow):
    height, flat = math.sin(math.radians(elevation)), math.cos(math.radians(elevation))
    turn = math.radians(around)
    way = (-flat * math.cos(turn), -height, -flat * math.sin(turn))
    return rj.DirectionalLight(way, shadow=rj.Shadow(**shadow))


def lamp(kind, elevation, scale=1.0, offset=(0.0, 0.0, 0.0), around=30.0, **shadow):
    way = np.array(sun(elevation, around).direction)
    place = -5.0 * scale * way + offset
    shadow = rj.Shadow(**shadow)
    if kind == "spot":
        return rj.SpotLight(
            place, way, intensity=min(scale**2, 1e9), outer_angle=40.0, shadow=shadow
        )
    return rj.PointLight(place, intensity=min(scale**2, 1e9), shadow=shadow)


def light_of(kind, elevation, scale=1.0, offset=(0.0, 0.0, 0.0), **shadow):
    if kind == "directional":
        return sun(elevation, **shadow)
    return lamp(kind, elevation, scale, offset, **shadow)


REACHES = {"hard": 1.5, "pcf": 3.5}
"""Texels from an edge of a shadow beyond which there is no sign of it."""

CASES = [
    (kernel, elevation, 1.0) for kernel in REACHES for elevation in (70.0, 40.0, 12.0, 3.0, 1.0)
] + [("pcf", 40.0, 1e-3), ("pcf", 3.0, 1e6), ("hard", 3.0, 1e3)]


class First:
    """The maps of the first picture that was drawn with shadows."""

    def __init__(self, caught):
        self.caught = caught

    @property
    def maps(self):
        return next(shadows for shadows in self.caught if shadows is not None).maps


@pytest.mark.parametrize(("kernel", "elevation", "scale"), CASES)
@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
def test_no_acne_and_no_gap(kernel, kind, elevation, scale, drawn):
    light = light_of(kind, elevation, scale, filter=kernel, size=512)
    scene, camera = box_on_ground(light, scale)
    share, dark, bright, _ = judge(scene, camera, light, First(drawn), REACHES[kernel])
    assert bright.sum() > 1000
    assert (share[bright] == 1.0).all()
    assert (share[dark] == 0.0).all()
    # Nearly level, little lies farther than that from an edge.
    assert dark.sum() > (20 if 2.0 < elevation < 60.0 else -1)


@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
def test_far_from_the_origin_nothing_changes(kind, drawn):
    offset = (3e6, -2e6, 1e6)
    light = light_of(kind, 40.0, 1.0, offset, filter="pcf", size=256)
    scene, camera = box_on_ground(light, 1.0, offset)
    near = light_of(kind, 40.0, filter="pcf", size=256)
    at_home, camera_at_home = box_on_ground(near)
    far, _ = shares(scene, camera)
    home, _ = shares(at_home, camera_at_home)
    assert np.array_equal(np.isnan(far), np.isnan(home))
    seen = np.isfinite(home)
    assert np.abs(far[seen] - home[seen]).max() < 1e-3
    assert (home[seen] == 0.0).any()


def test_other_objects_of_all_kinds_are_shaded_alike(drawn):
    # Many small faces, a mirrored and a stretched object, seen by a parallel camera.
    light = sun(35.0, filter="hard", size=1024)
    scene, _ = box_on_ground(light)
    scene.add(box(), tf.compose(tf.translate((1.5, 0.5, 0.5)), tf.rotate((1, 2, 3), 50.0),
                                tf.scale((0.3, -1.2, 0.6))))  # fmt: skip
    camera = rj.OrthographicCamera((4.0, 6.0, 7.0), (0.5, 0.0, 0.0), height=6.0)
    share, dark, bright, own = judge(scene, camera, light, First(drawn), 1.5)
    facing = share == share
    assert (share[bright & facing] == 1.0).all()
    assert (share[dark & facing] == 0.0).all()
    assert (dark & facing & (own < 2)).sum() > 100
    assert (bright & facing & (own >= 14)).sum() > 20


@pytest.mark.parametrize("kernel", ["hard", "pcf", "soft"])
@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
@pytest.mark.parametrize("shading", ["phong", "flat", "gouraud", "pbr"])
def test_what_nothing_shades_has_the_bits_of_light_without_shadows(kind, kernel, shading):
    # The box lies behind the plane: it is in the map, and shades nothing that is seen.
    soft = {"light_size": 0.5} if kernel == "soft" else {}
    light = light_of(kind, 50.0, filter=kernel, size=128, **soft)
    scene = rj.Scene()
    plane = ground()
    scene.add(rj.Mesh(plane.vertices, plane.faces, material=rj.Material(shading, "white")))
    scene.add(box(), tf.translate((0.0, -3.0, 0.0)))
    scene.add(box(), tf.translate((8.0, 0.5, 8.0)))
    scene.lights = [rj.AmbientLight(), light]
    camera = rj.PerspectiveCamera((0.0, 3.0, 2.0), (0.0, 0.0, 0.0), near=0.1)
    shown = rj.render(scene, camera, size=SIZE, outputs=("linear",), threads=1)
    plain = rj.render(without_shadow(scene), camera, size=SIZE, outputs=("linear",), threads=1)
    assert shown.plan.has("shadows")
    assert shown.linear.tobytes() == plain.linear.tobytes()


def wall_and_ground(light):
    """Return a half-plane of shadow: a wall that ends nowhere in sight, seen from above."""
    scene = rj.Scene()
    scene.add(ground(20.0))
    wall = rj.Mesh([[0, 0, -30], [0, 0, 30], [0, 4, 30], [0, 4, -30]], [[0, 1, 2], [0, 2, 3]])
    scene.add(wall)
    scene.lights = [light]
    return scene


def across(scene, x, z=0.0, width=240, height=4.0):
    """Return the shares along a line that a camera right above sees, and where they are."""
    camera = rj.OrthographicCamera((x, 10.0, z), (x, 0.0, z), up=(0, 0, -1), height=height / 60.0)
    share, frame = shares(scene, camera, (width, 4))
    return share[2], frame.position[2, :, 0]


def test_edge_of_a_filtered_shadow_rises_all_the_way():
    light = rj.DirectionalLight((1.0, -1.0, 0.0), shadow=rj.Shadow(size=64))
    share, _ = across(wall_and_ground(light), 4.0)
    assert (share[0], share[-1]) == (0.0, 1.0)
    assert (np.diff(share) >= -1e-6).all()
    # In many steps: comparisons are weighted by texels.
    assert len(np.unique(share)) > 10


def test_penumbra_grows_with_distance_as_geometry_says():
    # Half of the light's disk is hidden at the edge; the penumbra is as wide as the disk's angle.
    angle = 4.0
    widths = {}
    for top in (1.0, 2.0, 4.0):
        shadow = rj.Shadow(size=1024, filter="soft", light_size=angle)
        scene = rj.Scene()
        scene.add(ground(20.0))
        sheet = [[-8, top, -8], [0, top, -8], [0, top, 8], [-8, top, 8]]
        scene.add(rj.Mesh(sheet, [[0, 2, 1], [0, 3, 2]]))
        scene.lights = [rj.DirectionalLight((1.0, -1.0, 0.0), shadow=shadow)]
        # The sheet must not hide the edge of its shadow, at x = top.
        share, x = across(scene, top + 0.0, height=2.0)
        lit = share[x > 0.01]
        where = x[x > 0.01]
        inner = where[lit > 0.1][0]
        outer = where[lit < 0.9][-1]
        widths[top] = outer - inner
        assert abs((inner + outer) / 2.0 - top) < 0.05
    assert widths[1.0] < widths[2.0] < widths[4.0]
    # On a plane at 45 degrees the disk of the way sqrt(2) top is sqrt(2) as wide again; of a disk,
    # 10 % are behind the chord at 0.687 of its radius.
    expected = 4.0 * 2.0 * 2.0 * math.tan(math.radians(angle / 2.0)) * 0.687
    assert widths[4.0] == pytest.approx(expected, rel=0.2)


def test_cone_ends_the_light_by_its_angle():
    scene, camera = box_on_ground(lamp("spot", 60.0, filter="pcf", size=256))
    narrow = rj.SpotLight(
        scene.lights[0].position, scene.lights[0].direction, intensity=5.0, outer_angle=10.0,
        shadow=rj.Shadow(size=256),
    )  # fmt: skip
    scene.lights = [narrow]
    scene.nodes[1:] = []
    frame = rj.render(scene, camera, size=SIZE, outputs=("linear", "position"), threads=1)
    way = frame.position - np.array(narrow.position)
    with np.errstate(invalid="ignore"):
        angle = np.degrees(
            np.arccos((way @ np.array(narrow.direction)) / np.linalg.norm(way, axis=-1))
        )
    assert (frame.linear[angle > 10.01][:, :3] == 0.0).all()
    assert (frame.linear[angle < 9.0][:, 0] > 0.0).any()


def test_wide_cone_has_six_maps_and_the_same_shadow():
    place, way = (1.5, 4.0, 1.0), (-0.3, -1.0, -0.2)
    pictures = []
    for angle in (59.0, 61.0):
        light = rj.SpotLight(
            place, way, intensity=5.0, inner_angle=50.0, outer_angle=angle,
            shadow=rj.Shadow(size=1024, filter="hard"),
        )  # fmt: skip
        scene, camera = box_on_ground(light)
        pictures.append(shares(scene, camera)[0])
    lit = np.isfinite(pictures[0]) & np.isfinite(pictures[1])
    assert (pictures[0][lit] != pictures[1][lit]).mean() < 0.02
    assert (pictures[0][lit] == 0.0).any()


def test_vertices_of_gouraud_objects_are_shaded():
    light = sun(60.0, filter="hard", size=512)
    scene, camera = box_on_ground(light)
    lines = np.linspace(-6.0, 6.0, 41)
    x, z = (grid.ravel() for grid in np.meshgrid(lines, lines))
    corner = (np.arange(40)[:, np.newaxis] * 41 + np.arange(40)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 41, corner + 42], 1),
            np.stack([corner, corner + 42, corner + 1], 1),
        ]
    )  # fmt: skip
    mesh = rj.Mesh(
        np.stack([x, 0.0 * x, z], 1), faces, material=rj.Material("gouraud", "white", specular=0.0)
    )
    scene.nodes.clear()
    scene.add(mesh)
    scene.add(box(), tf.translate((-0.5, 0.0, -0.5)))
    share, frame = shares(scene, camera)
    on_mesh = (frame.face_id >= 0) & (frame.face_id < len(faces))
    assert (share[on_mesh] < 0.01).any()
    # Where all is bright, nothing is lost.
    far = on_mesh & (np.abs(frame.position[..., 0]) > 2.5)
    assert (share[far] == 1.0).all()


def test_holes_of_a_mask_let_light_through():
    pixels = np.zeros((8, 8, 4), np.uint8)
    pixels[..., :3] = 255
    pixels[:, :4, 3] = 255
    texture = rj.Texture(pixels, filter="nearest")
    leaf = rj.Mesh(
        [[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]], [[0, 2, 1], [0, 3, 2]],
        uv=[[0, 0], [1, 0], [1, 1], [0, 1]],
        material=rj.Material("flat", base_color_texture=texture, alpha_mode="mask"),
    )  # fmt: skip
    scene = rj.Scene()
    scene.add(ground())
    scene.add(leaf)
    scene.lights = [rj.DirectionalLight((0, -1, 0), shadow=rj.Shadow(filter="hard"))]
    camera = rj.PerspectiveCamera((0.0, 0.7, 4.0), (0.0, 0.0, 0.0))
    share, frame = shares(scene, camera)
    x, z = frame.position[..., 0], frame.position[..., 2]
    on_ground = (frame.face_id < 2) & (frame.face_id >= 0) & (np.abs(z) < 0.9)
    assert (share[on_ground & (x > 0.05)] == 1.0).all()
    under = on_ground & (x > -0.95) & (x < -0.05)
    assert under.sum() > 100
    assert (share[under] == 0.0).all()


def test_what_is_seen_through_casts_no_shadow_and_receives_them():
    light = rj.DirectionalLight((0.2, -1, 0), shadow=rj.Shadow(filter="hard"))
    glass = rj.Material("phong", (1, 1, 1, 0.5), alpha_mode="blend")
    pane = rj.Mesh([[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]], [[0, 2, 1], [0, 3, 2]],
                   material=glass)  # fmt: skip
    camera = rj.PerspectiveCamera((0.0, 3.0, 5.0), (0.0, 0.0, 0.0))
    scene = rj.Scene()
    scene.add(ground())
    scene.add(pane)
    scene.lights = [light]
    shown = rj.render(scene, camera, size=SIZE, outputs=("linear",)).linear
    plain = rj.render(without_shadow(scene), camera, size=SIZE, outputs=("linear",)).linear
    assert shown.tobytes() == plain.tobytes()
    scene.add(box(), tf.translate((-0.5, 2.0, -0.5)))
    both = [
        rj.render(each, camera, size=SIZE, outputs=("linear", "object_id"))
        for each in (scene, without_shadow(scene))
    ]
    on_pane = both[0].object_id == 1
    darker = (both[0].linear < both[1].linear)[..., 0]
    assert (on_pane & darker).sum() > 20


def test_casts_shadow_says_what_casts_them():
    scene = rj.Scene()
    scene.add(ground())
    scene.add(box(), tf.translate((-0.5, 1.0, -0.5)))
    scene.lights = [rj.DirectionalLight((0.2, -1, 0), shadow=rj.Shadow(filter="hard"))]
    camera = rj.PerspectiveCamera((0.0, 3.0, 5.0), (0.0, 0.0, 0.0))
    mesh, lit = scene.nodes[1].mesh, {}
    clear = {"alpha_mode": "blend", "base_color": (1, 1, 1, 0.5)}
    with rj.Renderer(SIZE) as renderer:
        for name, fields in (
            ("opaque", {}), ("none", {"casts_shadow": False}), ("none", clear),
            ("clear", {**clear, "casts_shadow": True}), ("opaque", {}),
        ):  # fmt: skip
            mesh.material = replace(rj.Material(), **fields)
            for _ in range(3):
                frame = renderer.render(scene, camera, outputs=("linear", "object_id"))
            fresh = rj.render(scene, camera, size=SIZE, outputs=("linear",))
            assert frame.linear.tobytes() == fresh.linear.tobytes()
            on_ground = np.where(frame.object_id == 0, frame.linear[..., 0], 0.0)
            assert (lit.setdefault(name, on_ground) == on_ground).all()
    assert (lit["opaque"] < 0.5 * lit["none"]).sum() > 50
    # Maps are fitted to what is seen, which is more behind what is clear.
    assert (lit["clear"] != lit["opaque"]).sum() <= 5


def ball(columns, rows):
    """Return a coarse sphere."""
    u = np.linspace(0.0, 2.0 * np.pi, columns, endpoint=False)
    v = np.linspace(0.0, np.pi, rows + 1)[1:-1, np.newaxis]
    rings = np.stack(
        [np.sin(v) * np.cos(u), np.cos(v) + 0.0 * u, np.sin(v) * np.sin(u)], axis=-1
    ).reshape(-1, 3)
    points = np.vstack([[[0.0, 1.0, 0.0]], rings, [[0.0, -1.0, 0.0]]])
    last, faces = len(points) - 1, []
    for i in range(columns):
        j = (i + 1) % columns
        faces.append((0, 1 + j, 1 + i))
        faces.append((last, last - columns + i, last - columns + j))
        for row in range(rows - 2):
            a, b = 1 + row * columns + i, 1 + row * columns + j
            faces += [(a, b, b + columns), (a, b + columns, a + columns)]
    return rj.Mesh(points, faces, material=rj.Material("phong", "white", specular=0.0))


def ball_over_ground(height, size, angle):
    """Return a ball of radius 0.6, a camera right above that sees a strip of ground, and light."""
    scene = rj.Scene()
    scene.add(ground(8.0))
    scene.add(ball(64, 32), tf.compose(tf.translate((0.0, height, 0.0)), tf.scale(0.6)))
    shadow = rj.Shadow(size=size, filter="soft", light_size=angle)
    scene.lights = [rj.DirectionalLight((1.0, -1.0, 0.0), shadow=shadow)]
    camera = rj.OrthographicCamera((1.0, 10.0, 0.0), (1.0, 0.0, 0.0), up=(0, 0, -1), height=2.0)
    return scene, camera


@pytest.mark.parametrize(("height", "size"), [(0.6, 2048), (1.5, 1024)])
def test_soft_shadow_of_a_ball_is_smooth_and_what_it_hides_of_the_light(height, size):
    # The strip is long: its far end is nearer to the light than the ball, by much.
    scene, camera = ball_over_ground(height, size, 6.0)
    share, frame = shares(scene, camera, (300, 40))
    seen = (frame.face_id >= 0) & (frame.face_id < 2)
    points = frame.position[seen].astype(float)
    truth = naive_shadows.share_beside_ball(points, (0.0, height, 0.0), 0.6, scene.lights[0])
    assert ((truth > 0.2) & (truth < 0.8)).sum() > 50
    wrong = np.abs(share[seen] - truth)
    assert wrong.max() < 0.18
    assert wrong.mean() < 0.003
    # From where it is darkest the light grows on both sides, along rows and columns.
    beside_ball = share[:, frame.position[20, :, 0] > 0.65]
    assert np.isfinite(beside_ball).all()
    for line in (*beside_ball, *beside_ball.T):
        darkest = np.flatnonzero(line == line.min())
        for way in (line[darkest[-1] :], line[: darkest[0] + 1][::-1]):
            assert (np.maximum.accumulate(way) - way).max() < 0.04


@pytest.mark.parametrize("angle", [20.0, 30.0, 60.0])
def test_the_penumbra_of_a_wide_sun_shows_no_more_bands_than_that_of_a_narrow_one(angle):
    def bands(angle):
        scene, camera = ball_over_ground(1.5, 1024, angle)
        share, frame = shares(scene, camera, (300, 40))
        x = frame.position[20, :, 0]
        return np.abs(np.diff(share[10:30, (x > 0.8) & (x < 4.5)], 2, axis=1)).mean()

    assert bands(angle) < 1.25 * bands(6.0)


@pytest.mark.parametrize("kernel", ["hard", "pcf"])
@pytest.mark.parametrize("columns", [8, 16, 48])
def test_a_ball_does_not_shade_itself_where_its_normals_face_the_light(columns, kernel):
    scene = rj.Scene()
    scene.add(ball(columns, columns // 2))
    scene.add(box(), tf.translate((0.0, -9.0, 0.0)))
    for way in ((-1.0, -0.6, -0.3), (0.3, -1.0, 0.2), (-1.0, 0.0, 0.0)):
        scene.lights = [rj.DirectionalLight(way, shadow=rj.Shadow(size=512, filter=kernel))]
        camera = rj.PerspectiveCamera((0.0, 1.0, 4.0), (0.0, 0.0, 0.0), fov_y=35.0)
        share, _ = shares(scene, camera, (160, 120))
        bright = rj.render(without_shadow(scene), camera, size=(160, 120), outputs=("linear",))
        lost = np.where(np.isfinite(share), 1.0 - share, 0.0) * bright.linear[..., 0]
        # What is lost stays below what an 8-bit picture shows near black, but for single pixels.
        assert (lost > 0.02).mean() < 2e-3


def test_light_that_reaches_nothing_is_left_out():
    near, far = rj.PointLight((0, 2, 0), range=5.0), rj.PointLight((0, 90, 0), range=50.0)
    scene, camera = box_on_ground(near)
    scene.lights = [rj.AmbientLight(), far, near]
    plan = rj.explain(scene, camera, size=SIZE)
    assert len(plan.lighting.lights) == 1
    assert plan.facts.lights.numbers == (0, 2)
    reason = next(effect.reason for effect in plan.effects if effect.name == "lights")
    assert reason.endswith("light 1: its range of 50 ends before all that is seen")
    frame = rj.render(scene, camera, size=SIZE, outputs=("linear",))
    scene.lights = [rj.AmbientLight(), near]
    again = rj.render(scene, camera, size=SIZE, outputs=("linear",))
    assert frame.linear.tobytes() == again.linear.tobytes()


def shadow_row_of(scene, camera, **arguments):
    plan = rj.explain(scene, camera, size=SIZE, **arguments)
    return next(effect for effect in plan.effects if effect.name == "shadows"), plan


def test_plan_says_which_maps_there_are_and_why():
    scene, camera = box_on_ground(rj.DirectionalLight((0, -1, 0)))
    row = shadow_row_of(scene, camera)[0]
    assert (row.used, row.reason) == (False, "no light casts them")
    scene.lights = [sun(30.0, size=1024)]
    row, plan = shadow_row_of(scene, camera)
    assert (row.used, row.reason) == (True, "1 map of 1024 x 1024, 4.2 MB")
    assert plan.has("shadows")
    assert plan.needs_depth
    scene.lights = [sun(30.0, size=1024), lamp("point", 40.0, size=256)]
    row = shadow_row_of(scene, camera)[0]
    assert row.reason == "1 map of 1024 x 1024, 6 maps of 256 x 256, 5.8 MB"
    only = rj.Scene()
    only.add(ground())
    only.lights = [sun(30.0)]
    row, plan = shadow_row_of(only, camera)
    assert (row.used, row.reason) == (False, "light 0: nothing lies between it and what is seen")
    assert not plan.has("shadows")
    row = shadow_row_of(scene, camera, outputs=("depth",))[0]
    assert (row.used, row.reason) == (False, "nothing is lit")


def test_a_light_in_front_of_which_nothing_lies_draws_no_map(drawn):
    scene, camera = box_on_ground(sun(40.0))
    scene.nodes[1:] = []
    scene.add(box(), tf.translate((0.0, -5.0, 40.0)))
    rj.render(scene, camera, size=SIZE)
    assert drawn == []


def test_scene_without_shadows_reads_no_maps(monkeypatch):
    scene, camera = box_on_ground(rj.DirectionalLight((0, -1, 0)))
    monkeypatch.setattr(shadow_maps, "draw_shadows", None)
    monkeypatch.setattr(visible_cells, "make_depth_cells", None)
    rj.render(scene, camera, size=SIZE)


@pytest.mark.parametrize("kind", ["parallel", "perspective", "cube"])
def test_what_has_no_place_on_a_map_is_lit_and_reads_texels_all_the_same(kind):
    # In front of the light; then too far for float32, on the plane of the light, and nowhere.
    points = np.array([[0.1, 0.2, 2.0], [-0.3, 0.1, 3.0], [1e60, 0, 2], [-1e150, 1e150, 1e-150],
                       [0, 0, 5e-324], [0, 5e-324, 0], [0, np.inf, 1], [np.nan, 0, 1]])  # fmt: skip
    rows = np.zeros((6, len(points)))
    rows[:3], rows[5] = points.T, -1.0
    size, sides = 16, 6 if kind == "cube" else 1
    row = np.zeros(shadows_stage.MAP_COLUMNS)
    row[:9], row[shadows_stage.FOCAL : shadows_stage.FOCAL + 4] = np.eye(3).ravel(), 8.0
    row[shadows_stage.NEAR], row[shadows_stage.FAR], row[shadows_stage.SPAN] = 0.1, 10.0, 10.0
    row[shadows_stage.TEXEL_DEPTH], row[shadows_stage.BIAS_TEXELS] = 0.1, 0.5
    row[shadows_stage.PARALLEL] = kind == "parallel"
    u, v, depth, across, down, bias, found, nearer, share = np.zeros((9, len(points)), np.float32)
    placed = u, v, depth, across, down, bias
    with np.errstate(all="ignore"):
        if kind == "cube":
            shadows_stage.project_samples_to_cube(*rows, row, size, *placed)
        else:
            shadows_stage.project_samples(*rows, row, *placed)
        assert np.isfinite((u, v)).all()
        texels = np.full(sides * size * size, 0.05, np.float32)
        cells = shadow_maps.find_occlusion_limits(texels.reshape(sides, size, size), 9.0)
        around = np.float32([[0, 0], [2, 0], [-2, 1], [0, -2]])
        for beside in (0, 1, 7):
            own = *(np.roll(one, beside) for one in placed), texels, size, np.float32(sides)
            soft = *own, np.float32(9.0)
            filters.mark_shaded(*soft, cells, around, np.ones_like(share), found)
            filters.read_soft(*soft, around / 2, around, found, nearer, share)
            light_leaks.remove_contact_leaks(
                *(np.roll(one, beside) for one in placed[:5]), texels, size, np.float32(sides),
                found, share,
            )  # fmt: skip
            assert np.isfinite(share).all()
            assert (np.roll(share, -beside)[2:] == 1.0)[(u[2:] < 0) | (u[2:] > size)].all()


@pytest.mark.parametrize(("size", "sides"), [(50, 1), (96, 6)])
def test_soft_shadow_of_a_sample_does_not_depend_on_its_block(size, sides):
    """Samples around a rough slope with a tower: alone, and with no limits to the search."""
    rng, count = np.random.default_rng(size), 200
    texels = np.arange(size) * 0.01 + rng.uniform(0.0, 0.005, (sides, size, size))
    texels[:, size // 4 : size // 2, size // 4 : size // 2] += 0.3
    texels = texels.astype(np.float32)
    u, v = rng.uniform(-0.1, 1.1, (2, count)).astype(np.float32) * size
    v = np.abs(v) % size + size * rng.integers(0, sides, count).astype(np.float32)
    depth = u * np.float32(0.01) + rng.uniform(-0.05, 0.1, count).astype(np.float32)
    # Steep planes: stored depths lie above them, and below the sample's own.
    across, down = rng.uniform(-0.1, 0.1, (2, count)).astype(np.float32)
    placed = u, v, depth, across, down, np.full(count, 1e-3, np.float32)
    maps = texels.ravel(), size, np.float32(sides), np.float32(60.0)
    cells, spiral = shadow_maps.find_occlusion_limits(texels, 60.0), shadow_maps.make_spiral(size)
    pattern = shadow_maps.make_disk_points()

    def read(some):
        marks, found, nearer, share = np.zeros((4, some.stop - some.start), np.float32)
        own = *(one[some] for one in placed), *maps
        filters.mark_shaded(*own, cells, spiral, np.ones_like(share), marks)
        filters.read_soft(*own, pattern, spiral, found, nearer, share)
        return marks, share

    _, together = read(slice(0, count))
    alone = np.hstack([read(slice(i, i + 1)) for i in range(count)])
    assert np.array_equal(together, alone[1])
    assert (together[alone[0] == 0.0] == 1.0).all()
    assert 0.0 < together.mean() < 1.0


@pytest.mark.parametrize("shading", ["flat", "phong", "pbr"])
def test_samples_that_turn_away_need_no_soft_shadow(monkeypatch, shading):
    """Lights from all around, on normals that are not those of the faces."""
    rng = np.random.default_rng(3)
    ball = trimesh.creation.icosphere(2)
    normals = ball.vertices + rng.normal(size=ball.vertices.shape) * 0.8
    mesh = rj.Mesh(
        ball.vertices * rng.uniform(0.8, 1.2, (len(ball.vertices), 1)), ball.faces,
        normals=normals, material=rj.Material(shading=shading, double_sided=True),
    )  # fmt: skip
    scene = rj.Scene()
    scene.add(mesh)
    scene.lights = [
        rj.DirectionalLight((1, -1, 1), shadow=rj.Shadow(64, "soft", 9.0)),
        rj.PointLight((2, 1, -2), intensity=9.0, shadow=rj.Shadow(64, "soft", 0.5)),
        rj.SpotLight((-2, 2, 1), (1, -1, -0.5), intensity=9.0, shadow=rj.Shadow(64, "soft", 0.5)),
    ]
    frames = []
    for answer in (True, False):
        monkeypatch.setattr(shadowing, "can_skip_turned_away", lambda needs, found=answer: found)
        frames.append(rj.render(scene, size=(80, 60), outputs=("linear",)).linear)
    assert np.array_equal(*frames)
