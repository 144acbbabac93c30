"""Transparent surfaces against exact arithmetic: each pixel, in any order of insertion."""

from __future__ import annotations

from functools import partial

import naive_layers
import numpy as np
import pytest
from naive_layers import CAMERA, mesh_of, scene_of

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.fragments import a_buffer
from rasterjit.pipeline.fragments import fragment_bands as band_finding
from rasterjit.rendering import resolve_layers

SIZE = (128, 64)
BACKGROUNDS = [(0.1, 0.2, 0.3, 1.0), (0.3, 0.2, 0.1, 0.25), (0, 0, 0, 0)]
"""Powers of two, so that screen points are exact in clip space."""

FULL = [(-128, -64), (384, -64), (-128, 192)]
"""A triangle over the whole image."""


def soup(rng, count, size=SIZE, reach=1.2):
    """Return random triangles that intersect: points on 1/256 pixel, depths on 2**-20."""
    triangles = []
    for _ in range(count):
        middle, extent = rng.uniform(0, 1, 2) * size, rng.uniform(0.5, reach) * size[1] * 2
        points = np.round((middle + rng.uniform(-extent, extent, (3, 2))) * 256) / 256
        triangles.append((points.tolist(), (np.round(rng.uniform(-0.9, 0.9, 3) * 2**20) / 2**20)))
    return triangles


def colors_of(rng, count, alphas=(0.0, 1.0)):
    """Return random colours whose alphas lie between two, float32 values."""
    colors = rng.uniform(0, 1, (count, 4))
    colors[:, 3] = rng.uniform(*alphas, count)
    return colors.astype(np.float32).astype(float)


def meshes_of(triangles, colors, is_blended, size=SIZE):
    return [
        mesh_of(
            points, depths, size, base_color=color.tolist(),
            alpha_mode="blend" if blended else "opaque",
        )
        for (points, depths), color, blended in zip(triangles, colors, is_blended, strict=True)
    ]  # fmt: skip


def draw(meshes, size=SIZE, background=(0.1, 0.2, 0.3, 1.0), outputs=("linear",), **options):
    options.setdefault("threads", 1)
    return rj.render(
        scene_of(meshes), CAMERA, size=size, background=background, outputs=outputs, **options
    )


def expected(surfaces, colors, is_blended, background, size=SIZE):
    """Return the picture that the twin makes, (H, W, 4) float64."""
    opaque = np.array([[*color[:3], color[3] if blended else 1.0]
                       for color, blended in zip(colors, is_blended, strict=True)])  # fmt: skip
    seen = partial(naive_layers.seen_faces, is_blended=is_blended)
    return naive_layers.picture(surfaces, seen, opaque, background, size)


def test_the_fast_twin_has_the_surfaces_of_the_oracle():
    rng, size, places = np.random.default_rng(50), (16, 8), ((8, 8), (9, 1), (0, 15))
    triangles = soup(rng, 12, size)
    # Edges through samples, a triangle without area, and equal depths.
    triangles += [
        (rng.integers(0, 32, (3, 2)) / 2, rng.integers(0, 3, 3) / 4) for _ in range(24)
    ]  # fmt: skip
    triangles += [([(1, 1), (3, 3), (5, 5)], [0.1, 0.2, 0.3]), *triangles[5:9]]
    # Depths that float64 does not tell apart, but fractions do.
    corner = [(0, 0), (16, 0), (0, 8)]
    triangles += [(corner, [0.25, 0.25, np.nextafter(0.25, 1.0)]), (corner, [0.25] * 3)]
    tied = 0
    for x, y in places:
        place, want = (naive_layers.Fraction(x, 16), naive_layers.Fraction(y, 16)), {}
        for face, (points, depths) in enumerate(triangles):
            corners = oracle.snap_triangle(points)
            for column, row in oracle.covered_pixels(points, size, sample=place):
                where = (column + place[0]) * 256, (row + place[1]) * 256
                depth = oracle.depth_at(corners, depths, where)
                want.setdefault((column, row), []).append((depth, face))
        have = naive_layers.exact_surfaces(triangles, size, place)
        assert have.keys() == want.keys()
        for pixel, found in want.items():
            assert have[pixel] == [(float(depth), face) for depth, face in sorted(found)]
            tied += len({depth for depth, _ in found}) < len(found)
    assert tied > 100


def test_every_pixel_shows_what_exact_arithmetic_says():
    rng = np.random.default_rng(51)
    for _ in range(3):
        triangles, count = soup(rng, 16), 16
        colors, is_blended = colors_of(rng, count, (0.1, 0.9)), rng.random(count) < 0.9
        exact = naive_layers.exact_surfaces(triangles, SIZE)
        # Depths that only exact numbers tell apart are true ties of the stored ones.
        rounded = naive_layers.rounded_surfaces(triangles, SIZE)
        tied = [pixel for pixel in exact if [f for _, f in exact[pixel]] != [
            f for _, f in rounded[pixel]]]  # fmt: skip
        for pixel in tied:
            nearness = [depth for depth, _ in rounded[pixel]]
            assert len(set(nearness)) < len(nearness)
        assert len(tied) < 3
        depth = [len(naive_layers.seen_faces(found, is_blended)) for found in exact.values()]
        assert max(depth) > 3
        meshes = meshes_of(triangles, colors, is_blended)
        for background in BACKGROUNDS:
            want = expected(exact, colors, is_blended, background)
            have = draw(meshes, background=background).linear
            for column, row in tied:
                want[row, column] = have[row, column]
            np.testing.assert_allclose(have, want, rtol=0, atol=3e-6)


def test_layers_are_those_of_the_stored_depths_bit_by_bit(monkeypatch):
    rng = np.random.default_rng(52)
    count, bands = 40, []
    triangles = soup(rng, count)
    # Some triangles are there twice: exact ties, that the lower face wins.
    triangles[20:30] = triangles[5:15]
    is_blended = np.arange(count) % 7 != 3
    composite_layers = resolve_layers.composite_layers

    def note(band, *others):
        opaque, transparent = band.opaque[0].copy(), band.transparent[0].copy()
        bands.append(band_finding.Band(band.first_row, opaque, transparent))
        return composite_layers(band, *others)

    monkeypatch.setattr(resolve_layers, "composite_layers", note)
    draw(meshes_of(triangles, colors_of(rng, count), is_blended))
    want = naive_layers.rounded_surfaces(triangles, SIZE)
    rows = 0
    for band in bands:
        for row, column in np.ndindex(band.opaque.shape):
            pixel = column, band.first_row + row
            faces = naive_layers.seen_faces(want.get(pixel, []), is_blended)
            have = [int(f) for f in band.transparent[:, row, column] if f >= 0]
            if band.opaque[row, column] >= 0:
                have.append(int(band.opaque[row, column]))
            assert have == faces, pixel
        rows += len(band.opaque)
    assert rows == SIZE[1]


def test_order_of_insertion_changes_no_bit():
    rng = np.random.default_rng(53)
    triangles, count = soup(rng, 20), 20
    colors, is_blended = colors_of(rng, count), rng.random(count) < 0.8
    meshes = meshes_of(triangles, colors, is_blended)
    first = draw(meshes)
    for _ in range(3):
        order = rng.permutation(count)
        assert draw([meshes[n] for n in order]).linear.tobytes() == first.linear.tobytes()


@pytest.mark.parametrize("size", [(1, 1), (63, 65), (128, 64), (130, 129), (200, 7)])
def test_threads_and_sizes_change_no_bit(size):
    rng = np.random.default_rng(54)
    count = 12
    meshes = [
        rj.Mesh(
            rng.uniform(-1.3, 1.3, (3, 3)), [[0, 1, 2]],
            material=rj.Material("unlit", rng.uniform(0, 1, 4), alpha_mode="blend"),
        )
        for _ in range(count)
    ]  # fmt: skip
    both = ("linear", "color")
    one = draw(meshes, size, outputs=both)
    for threads in (2, 5):
        other = draw(meshes, size, outputs=both, threads=threads)
        assert other.linear.tobytes() == one.linear.tobytes()
        assert other.color.tobytes() == one.color.tobytes()
    # Each output alone is the same.
    assert draw(meshes, size).linear.tobytes() == one.linear.tobytes()
    assert draw(meshes, size, outputs=("color",)).color.tobytes() == one.color.tobytes()


def cut(frame, left, top, width, height):
    return frame.linear[top : top + height, left : left + width]


def test_tiles_leave_no_trace():
    # The same triangles, moved by whole pixels: another tile, the same colours.
    rng = np.random.default_rng(55)
    size, count = (256, 256), 10
    triangles = soup(rng, count, (64, 64), 0.6)
    colors = colors_of(rng, count)
    pictures = []
    for shift in (64, 96, 117):
        moved = [((np.array(points) + shift).tolist(), z) for points, z in triangles]
        frame = draw(meshes_of(moved, colors, np.ones(count, bool), size), size)
        pictures.append(cut(frame, shift - 40, shift - 40, 128, 128).copy())
    for other in pictures[1:]:
        np.testing.assert_allclose(other, pictures[0], rtol=0, atol=2e-6)


def test_alpha_1_is_opaque_bit_by_bit(cube, sphere, camera):
    # One face of the sphere, far off to the side, has an alpha below 1: so all are blended.
    colors = np.ones((len(sphere.faces), 4))
    shown = rj.render(sphere, camera, size=(80, 60), outputs=("face_id",)).face_id
    hidden = sorted(set(range(len(sphere.faces))) - set(shown.ravel().tolist()))
    colors[hidden[0], 3] = 0.5
    for shading in ("phong", "flat", "unlit"):
        frames = []
        for mode in ("opaque", "blend"):
            scene = rj.Scene()
            for mesh in (sphere, cube):
                own = colors if mesh is sphere else np.ones((len(cube.faces), 4))
                scene.add(
                    rj.Mesh(
                        mesh.vertices * (1.0 if mesh is sphere else 0.7), mesh.faces, colors=own,
                        material=rj.Material(shading, "orange", alpha_mode=mode),
                    )
                )  # fmt: skip
            frames.append(
                rj.render(scene, camera, size=(80, 60), outputs=("linear", "color"), threads=1)
            )
        assert frames[0].plan.layers is None
        assert frames[1].plan.layers is not None
        for name in ("linear", "color"):
            one, other = (frame.arrays()[name] for frame in frames)
            assert one.tobytes() == other.tobytes(), (shading, name)


def test_alpha_0_changes_nothing(cube, camera):
    other = rj.Mesh(
        cube.vertices * 1.5, cube.faces,
        material=rj.Material(base_color=(1, 0, 0, 0.0), alpha_mode="blend"),
    )  # fmt: skip
    for background in ("white", "transparent", (0.2, 0.4, 0.6, 0.3)):
        options = dict(size=(60, 50), outputs=("linear", "color"), background=background)
        scene = scene_of([cube, other])
        with_it = rj.render(scene, camera, **options)
        assert with_it.plan.layers is not None
        alone = rj.render(scene_of([cube]), camera, **options)
        assert with_it.linear.tobytes() == alone.linear.tobytes()
        assert with_it.color.tobytes() == alone.color.tobytes()


@pytest.mark.parametrize("where", ["material", "vertices", "faces", "texture", "all"])
def test_alphas_are_multiplied(where):
    uv = [(0.25, 0.5), (0.25, 0.5), (0.25, 0.5)]
    alphas = {"material": 0.5, "vertices": 0.75, "faces": 0.25, "texture": 0.5}
    wanted = {name for name in alphas if where in (name, "all")} - (
        {"faces"} if where == "all" else set()
    )
    texture = rj.Texture(np.full((1, 2, 4), [1.0, 1.0, 1.0, 0.5], np.float32), filter="nearest")
    colors = None
    if "vertices" in wanted:
        colors = np.full((3, 4), [1, 1, 1, 0.75])
    if "faces" in wanted:
        colors = np.full((1, 4), [1, 1, 1, 0.25])
    plain = mesh_of(FULL, [0.0] * 3, SIZE)
    mesh = rj.Mesh(
        plain.vertices, plain.faces, colors=colors, uv=uv if "texture" in wanted else None,
        material=rj.Material(
            "unlit", (1, 1, 1, 0.5 if "material" in wanted else 1.0), alpha_mode="blend",
            base_color_texture=texture if "texture" in wanted else None,
        ),
    )  # fmt: skip
    want = np.prod([alphas[name] for name in wanted])
    assert (draw([mesh], background=(0, 0, 0, 1)).linear[..., 0] == np.float32(want)).all()
    assert (draw([mesh], background=(0, 0, 0, 0)).linear[..., 3] == np.float32(want)).all()


def test_vertex_alpha_is_interpolated():
    points = [(0, 0), (256, 0), (0, 128)]
    plain = mesh_of(points, [0.0] * 3, SIZE)
    colors = np.array([[1, 1, 1, 0.0], [1, 1, 1, 1.0], [1, 1, 1, 0.0]])
    mesh = rj.Mesh(
        plain.vertices, plain.faces, colors=colors,
        material=rj.Material("unlit", "white", alpha_mode="blend"),
    )  # fmt: skip
    have = draw([mesh], background=(0, 0, 0, 1)).linear[..., 0]
    row = (np.arange(128) + 0.5) / 256
    np.testing.assert_allclose(have[3], row, atol=1e-6)


def test_sixteen_layers_over_the_whole_screen():
    rng = np.random.default_rng(56)
    count = 16
    colors = colors_of(rng, count, (0.2, 0.6))
    depths = rng.permutation(count) / 32 - 0.25
    meshes = [
        mesh_of(FULL, [z] * 3, SIZE, base_color=color.tolist(), alpha_mode="blend")
        for z, color in zip(depths, colors, strict=True)
    ]
    want = naive_layers.over(np.argsort(depths).tolist(), colors, (0.1, 0.2, 0.3, 1.0))
    have = draw(meshes).linear
    np.testing.assert_allclose(have, np.broadcast_to(want, have.shape), atol=2e-6)


def deep(count, size):
    """Return one blended mesh of so many triangles behind each other over one pixel."""
    points = np.array([(8, 8), (12, 8), (8, 12)])
    triangles = np.concatenate(
        [mesh_of(points, [0.9 - 1.8 * n / count] * 3, size).vertices for n in range(count)]
    )
    return rj.Mesh(
        triangles, np.arange(3 * count).reshape(-1, 3),
        material=rj.Material("unlit", (1.0, 0.5, 0.0, 0.01), alpha_mode="blend"),
    )  # fmt: skip


def test_hundreds_of_layers_are_laid_over_each_other(monkeypatch):
    size, count = (64, 64), 300
    want = 1.0 - 0.99**count
    frame = draw([deep(count, size)], size, background=(0, 0, 0, 1))
    assert frame.linear[8, 8, 0] == pytest.approx(want, abs=1e-4)
    # A band with more than it may hold is cut into smaller ones.
    monkeypatch.setattr(band_finding, "MAX_BYTES", count * 64 * 8 * 3)
    again = draw([deep(count, size)], size, background=(0, 0, 0, 1))
    assert again.linear.tobytes() == frame.linear.tobytes()


def test_more_layers_than_are_sorted_is_an_error_that_says_where(monkeypatch):
    size = (64, 64)
    monkeypatch.setattr(band_finding, "MAX_LAYERS", 99)
    assert draw([deep(99, size)], size).linear[8, 8, 0] > 0.0
    with pytest.raises(ValueError, match=r"has 100 transparent surfaces .* column 8, row 8; at m"):
        draw([deep(100, size)], size)
    monkeypatch.undo()
    with pytest.raises(ValueError, match=r"4097 transparent surfaces .* at most 4096"):
        draw([deep(4097, size)], size)


def test_culled_faces_are_no_layers():
    one = mesh_of([(0, 0), (64, 0), (0, 64)], [0.0] * 3, SIZE, base_color=(1, 0, 0, 0.5),
                  alpha_mode="blend")  # fmt: skip
    other = rj.Mesh(one.vertices, one.faces[:, ::-1], material=one.material)
    shown = {}
    for cull in ("none", "back", "front"):
        shown[cull] = [draw([mesh], cull=cull).linear[10, 10, 3 - 3] for mesh in (one, other)]
    assert shown["none"][0] == shown["none"][1] > 0.5
    assert sorted(shown["back"]) == sorted(shown["front"])
    assert shown["back"] == shown["front"][::-1]
    assert min(shown["back"]) == np.float32(0.1)


def test_clipped_transparent_faces():
    # A floor that begins behind the eye, seen through nothing but itself.
    camera = rj.PerspectiveCamera(eye=(0, 1, 0), target=(0, 0.8, -1), near=0.1, far=100.0)
    floor = [[-50, 0, 50], [50, 0, 50], [50, 0, -50], [-50, 0, -50]]
    size = (96, 64)

    def frame(color, mode):
        material = rj.Material("unlit", color, alpha_mode=mode)
        mesh = rj.Mesh(floor, [[0, 1, 2], [0, 2, 3]], material=material)
        return rj.render(mesh, camera, size=size, background="black", outputs=("linear",))

    half, whole = frame((1, 1, 1, 0.5), "blend"), frame((1, 1, 1), "opaque")
    assert half.stats.clipped == whole.stats.clipped > 0
    assert (whole.linear[..., 0] == 1.0).sum() > 1000
    # Also where two pieces of a cut face meet, nothing is there twice or missing.
    np.testing.assert_array_equal(half.linear[..., 0], 0.5 * whole.linear[..., 0])


def test_buffers_show_the_nearest_surface_transparent_or_not(cube, camera):
    glass = rj.Mesh(
        cube.vertices * 1.2, cube.faces,
        material=rj.Material("phong", (0, 0, 1, 0.3), alpha_mode="blend"),
    )  # fmt: skip
    solid = rj.Mesh(cube.vertices * 1.2, cube.faces)
    outputs = ("depth", "face_id", "object_id", "normal", "position", "linear", "barycentric")
    options = dict(size=(64, 48), outputs=outputs, threads=1)
    seen = rj.render(scene_of([cube, glass]), camera, **options)
    opaque = rj.render(scene_of([cube, solid]), camera, **options)
    for name in outputs:
        if name != "linear":
            one, other = seen.arrays()[name], opaque.arrays()[name]
            assert one.tobytes() == other.tobytes(), name
    assert seen.stats.drawn == opaque.stats.drawn
    assert seen.stats.pixels_covered == opaque.stats.pixels_covered


def reason(plan, name):
    (effect,) = [effect for effect in plan.effects if effect.name == name]
    return effect.used, effect.reason


def glass(alpha=0.5, **options):
    return rj.Material("unlit", (1, 0, 0, alpha), alpha_mode="blend", **options)


def test_plan_says_why_nothing_is_transparent(cube, camera):
    scene = scene_of([cube])
    assert reason(rj.explain(scene, camera), "transparency") == (False, "no material is blended")
    blended = rj.Mesh(cube.vertices, cube.faces, material=glass())
    node = scene.add(blended, name="pane")
    plan = rj.explain(scene, camera)
    assert reason(plan, "transparency") == (True, "1 blended object")
    assert plan.layers.is_blended.tolist() == [0, 1]
    assert reason(rj.explain(scene, camera, outputs="depth"), "transparency") == (
        False, "nothing is shaded",
    )  # fmt: skip
    node.world_from_model = rj.transforms.translate([100.0, 0.0, 0.0])
    plan = rj.explain(scene, camera)
    assert plan.layers is None
    assert reason(plan, "transparency") == (False, "object 'pane' lies outside the view")
    node.mesh = rj.Mesh(cube.vertices, cube.faces, material=glass(1.0))
    node.world_from_model = np.eye(4)
    plan = rj.explain(scene, camera)
    assert plan.layers is None
    assert reason(plan, "transparency") == (False, "every blended surface has alpha 1")


def test_object_at_the_border_of_the_view_is_drawn():
    # Moved out of the picture pixel by pixel: as long as a pixel shows it, the plan has it.
    for shift in np.arange(0.9, 1.2, 0.02):
        square = rj.Mesh(
            np.array([[0, -1, 0], [1, -1, 0], [1, 1, 0], [0, 1, 0]]) + [shift, 0, 0],
            [[0, 1, 2], [0, 2, 3]], material=glass(),
        )  # fmt: skip
        frame = draw([square], outputs=("linear", "face_id"))
        shown = (frame.face_id >= 0).any()
        assert shown == (frame.linear[..., 0] > 0.2).any()
        if shown:
            assert frame.plan.layers is not None
        if shift > 1.01:
            assert frame.plan.layers is None


def test_nothing_of_it_runs_where_nothing_is_transparent(monkeypatch, cube, camera):
    def refuse(*_):
        raise AssertionError("there is nothing transparent")

    for name in ("split_lists", "find_layers"):
        monkeypatch.setattr(a_buffer, name, refuse)
    away = rj.Mesh(cube.vertices + [100.0, 0, 0], cube.faces, material=glass())
    scene = scene_of([cube, away])
    assert rj.render(scene, camera, size=(32, 24)).color.any()
    inside = scene_of([cube, rj.Mesh(cube.vertices, cube.faces, material=glass())])
    with pytest.raises(AssertionError, match="nothing transparent"):
        rj.render(inside, camera, size=(32, 24))


def test_wireframe_alone_shades_no_layers(cube, camera):
    scene = scene_of([rj.Mesh(cube.vertices, cube.faces, material=glass())])
    scene.wireframe = rj.Wireframe(mode="only")
    assert rj.render(scene, camera, size=(32, 24)).plan.layers is None
    scene.wireframe = rj.Wireframe(mode="overlay")
    assert rj.render(scene, camera, size=(32, 24)).plan.layers is not None


# --- the nearest layers alone ---------------------------------------------------------------------

LEVELS = [1, 2, 4, 8]


def nearest(surfaces, is_blended, most):
    """Return the faces that are seen if so many transparent ones are: the opaque one always is."""
    faces = naive_layers.seen_faces(surfaces, is_blended)
    transparent = [face for face in faces if is_blended[face]]
    return transparent[:most] + [face for face in faces if not is_blended[face]]


@pytest.mark.parametrize("most", LEVELS)
def test_the_nearest_transparent_faces_alone_are_seen(most):
    rng, count, background = np.random.default_rng(57), 30, (0.1, 0.2, 0.3, 1.0)
    triangles = soup(rng, count)
    # Exact ties: the lower face is nearer.
    triangles[20:] = triangles[5:15]
    colors, is_blended = colors_of(rng, count, (0.1, 0.9)), rng.random(count) < 0.9
    own = [
        [*c[:3], c[3] if blended else 1.0] for c, blended in zip(colors, is_blended, strict=True)
    ]
    surfaces = naive_layers.rounded_surfaces(triangles, SIZE)
    seen = partial(nearest, is_blended=is_blended, most=most)
    want = naive_layers.picture(surfaces, seen, own, background, SIZE)
    meshes = meshes_of(triangles, colors, is_blended)
    quality = rj.Quality(transparency_layers=most)
    frame = draw(meshes, quality=quality)
    np.testing.assert_allclose(frame.linear, want, rtol=0, atol=3e-6)
    assert np.abs(frame.linear - draw(meshes).linear).max() > (0.01 if most < 8 else 0.0)
    # Neither order of insertion nor threads change a bit but where faces tie.
    again = draw(meshes, quality=quality, threads=3)
    assert again.linear.tobytes() == frame.linear.tobytes()


def test_order_of_insertion_decides_nothing_of_what_is_left_out():
    rng, count = np.random.default_rng(58), 20
    triangles = soup(rng, count)
    meshes = meshes_of(triangles, colors_of(rng, count), rng.random(count) < 0.9)
    for most in (1, 4):
        quality = rj.Quality(transparency_layers=most)
        first = draw(meshes, quality=quality).linear.tobytes()
        for _ in range(2):
            order = rng.permutation(count)
            other = draw([meshes[n] for n in order], quality=quality)
            assert other.linear.tobytes() == first


@pytest.mark.parametrize("samples", [1, 4])
def test_as_many_layers_as_there_are_is_all_of_them_bit_by_bit(samples):
    rng, count = np.random.default_rng(59), 8
    meshes = meshes_of(soup(rng, count), colors_of(rng, count), np.ones(count, bool))
    one, other = (
        draw(meshes, quality=rj.Quality(samples=samples, transparency_layers=most))
        for most in (8, "all")
    )
    assert one.linear.tobytes() == other.linear.tobytes()


def test_each_sample_has_its_own_nearest_layers():
    # Two panes that cross within pixels: at each sample another one is nearer.
    rng, count, background = np.random.default_rng(60), 10, (0.1, 0.2, 0.3, 1.0)
    size = (32, 16)
    triangles = soup(rng, count, size)
    colors, is_blended = colors_of(rng, count, (0.2, 0.8)), np.ones(count, bool)
    seen, shown = partial(nearest, is_blended=is_blended, most=2), []
    offsets = [(6, 2), (14, 6), (2, 10), (10, 14)]
    for x, y in offsets:
        place = naive_layers.Fraction(x, 16), naive_layers.Fraction(y, 16)
        surfaces = naive_layers.rounded_surfaces(triangles, size, place)
        shown.append(naive_layers.picture(surfaces, seen, colors, background, size))
    want = naive_layers.mean(np.stack(shown, axis=2))
    quality = rj.Quality(samples=4, transparency_layers=2)
    have = draw(meshes_of(triangles, colors, is_blended, size), size, quality=quality)
    np.testing.assert_allclose(have.linear, want, rtol=0, atol=3e-6)


def test_any_number_of_surfaces_lies_behind_those_that_are_seen(monkeypatch):
    monkeypatch.setattr(band_finding, "MAX_LAYERS", 9)
    size = (64, 64)
    quality = rj.Quality(transparency_layers=8)
    frame = draw([deep(300, size)], size, background=(0, 0, 0, 1), quality=quality)
    assert frame.linear[8, 8, 0] == pytest.approx(1.0 - 0.99**8, abs=1e-6)
    with pytest.raises(ValueError, match="300 transparent surfaces"):
        draw([deep(300, size)], size)


def test_no_more_layers_are_held_or_shaded_than_are_seen(monkeypatch):
    shaded, rooms = [], []
    shade, find = resolve_layers.Shading.shade, a_buffer.find_layers
    monkeypatch.setattr(resolve_layers.Shading, "shade", lambda *a: shaded.append(1) or shade(*a))
    monkeypatch.setattr(
        a_buffer, "find_layers",
        lambda *a: rooms.append(a[8][1].shape[1]) or find(*a),
    )  # fmt: skip
    size = (16, 16)
    for most in LEVELS:
        shaded.clear()
        rooms.clear()
        draw([deep(40, size)], size, quality=rj.Quality(transparency_layers=most))
        # And once for what is opaque.
        assert len(shaded) == most + 1
        assert rooms == [most]


def test_plan_says_how_many_layers_are_seen(cube, camera):
    scene = scene_of([rj.Mesh(cube.vertices, cube.faces, material=glass())])
    for most, text in ((1, ", the nearest one at a sample"), (4, ", the nearest 4 at a sample")):
        plan = rj.explain(scene, camera, rj.Quality(transparency_layers=most))
        assert reason(plan, "transparency") == (True, "1 blended object" + text)
        assert plan.layers.most == most
    plain = rj.explain(scene_of([cube]), camera, rj.Quality(transparency_layers=2))
    assert reason(plain, "transparency") == (False, "no material is blended")


@pytest.mark.parametrize("most", [0, 3, -1, 16, 1.5, "one", None, True])
def test_bad_number_of_layers_is_refused(most):
    with pytest.raises(ValueError, match=r"transparency_layers.*1, 2, 4, 8"):
        rj.Quality(transparency_layers=most)


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("alpha", [1e-7, 3.1e-8, 2.9e-8, 1e-9])
def test_bright_layer_is_seen_however_small_its_alpha(samples, alpha):
    # 1 - alpha is 1 in float32 below 3e-8; what shines is not: its light is a million.
    glass = mesh_of(FULL, [0.5] * 3, SIZE, base_color=(0, 0, 0, alpha), alpha_mode="blend")
    glass.material = rj.Material(
        "pbr", (0, 0, 0, alpha), alpha_mode="blend", emissive=(1e6, 5e5, 0), roughness=1.0
    )
    edge = mesh_of([(10, 10), (90, 13), (40, 60)], [0.6] * 3, SIZE, base_color="black")
    options = {"background": "black", "quality": rj.Quality(samples=samples)}
    scene = scene_of([glass, edge])
    frame = rj.render(scene, CAMERA, size=SIZE, outputs=("linear",), threads=1, **options)
    want = np.float32(alpha) * np.array([1e6, 5e5, 0.0])
    shown = frame.linear[..., :3]
    np.testing.assert_allclose(shown, want + 0 * shown, rtol=1e-5, atol=2e-7)
    batch = rj.render_batch(scene, [CAMERA], size=SIZE, outputs=("linear",), **options)
    assert batch.linear[0].tobytes() == frame.linear.tobytes()
