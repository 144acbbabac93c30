"""Alpha masks cut the samples that an exact twin drops, and change no bit of those that stay."""

from __future__ import annotations

import naive_alpha_tests as naive
import numpy as np
import pytest
from naive_textures import FRONT, box, clip_camera, square

import rasterjit as rj
from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.geometry.setup import CLIPPED
from rasterjit.pipeline.records import Geometry, Viewport

SIZE = (150, 100)
"""Six tiles, some of them cut off."""

OUTPUTS = ("color", "linear", "depth", "face_id", "object_id", "barycentric")
CHECKER = np.ones((8, 8, 4), np.float32)
CHECKER[..., 3] = np.indices((8, 8)).sum(axis=0) % 2


def masked(texture=None, cutoff=0.5, **options):
    return rj.Material(
        "unlit", alpha_mode="mask", alpha_cutoff=cutoff, base_color_texture=texture,
        **{"base_color": "white", **options},
    )  # fmt: skip


def covered(mesh, size):
    """Tell which pixels of an image of [-1, 1]**2 a mesh covers."""
    scene = rj.Scene()
    scene.add(mesh, rj.transforms.scale((size[0] / size[1], 1.0, 1.0)))
    return rj.render(scene, FRONT, size=size, outputs="face_id", threads=1).face_id >= 0


def same_bits(one, other):
    for name in OUTPUTS:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def corners_of(points, ws):
    """Return the vertices that land on screen points with the given w, seen by `clip_camera`."""
    width, height = SIZE
    return [
        ((2 * x / width - 1) * w, (1 - 2 * y / height) * w, -w)
        for (x, y), w in zip(points, ws, strict=True)
    ]


@pytest.fixture
def stones():
    """Return a rough field of small triangles, one layer, that reaches beyond the picture."""
    side = np.linspace(-1.5, 1.5, 60)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side, indexing="ij"))
    depth = np.random.default_rng(0).uniform(-0.3, 0.3, len(x))
    i, j = (axis.ravel() for axis in np.indices((59, 59)))
    a, b = 60 * i + j, 60 * i + j + 60
    faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
    return np.column_stack([x, y, depth]), faces


# Absent equals neutral


@pytest.mark.parametrize("hidden_hole", [False, True], ids=["planned out", "computed"])
@pytest.mark.parametrize("kind", ["small", "wide", "thin", "clipped"])
def test_a_mask_without_holes_changes_no_bit(sphere, camera, kind, hidden_hole):
    # The hole is where no coordinate of the mesh leads: the mask is computed and cuts nothing.
    pixels = np.random.default_rng(1).random((4, 16, 4)).astype(np.float32)
    pixels[..., 3] = 1.0
    pixels[:, 12:, 3] = 0.0 if hidden_hole else 1.0
    texture = rj.Texture(pixels, filter="nearest", wrap="clamp")
    if kind == "small":
        vertices, faces = sphere.vertices, np.concatenate([sphere.faces] * 2)
        camera = rj.PerspectiveCamera(eye=(0, 1, 12), target=(0, 0, 0))
    elif kind == "thin":
        angles = np.linspace(0, 2 * np.pi, 90)
        vertices = np.stack([2 * np.cos(angles), 2 * np.sin(angles), 0.3 * np.sin(9 * angles)], 1)
        faces = [(k, k + 44, k + 45) for k in range(45)]
    else:
        vertices, faces = sphere.vertices, sphere.faces
        if kind == "clipped":
            camera = rj.PerspectiveCamera(eye=(0, 0, 0.5), target=(1, 0, 0), near=0.2)
    uv = np.random.default_rng(2).uniform(0.0, 0.7, (len(vertices), 2))
    frames = []
    for mode in ("opaque", "mask"):
        material = rj.Material("unlit", "white", base_color_texture=texture, alpha_mode=mode)
        mesh = rj.Mesh(vertices, faces, uv=uv, material=material)
        frames.append(rj.render(mesh, camera, size=SIZE, outputs=OUTPUTS, threads=1))
    assert [frame.plan.facts.needs_alpha_tests for frame in frames] == [False, hidden_hole]
    assert frames[0].stats.pixels_covered > 100
    assert (frames[0].stats.clipped > 0) == (kind == "clipped")
    same_bits(*frames)


@pytest.mark.needs_jit
def test_the_border_of_the_picture_leaves_nothing_in_tiles_below(stones):
    # The last tiles of a row are narrow, and triangles are drawn beyond them by whole groups.
    pixels = np.ones((4, 16, 4), np.float32)
    pixels[:, 12:, 3] = 0.0
    texture = rj.Texture(pixels, filter="nearest", wrap="clamp")
    vertices, faces = stones
    uv = np.random.default_rng(2).uniform(0.0, 0.7, (len(vertices), 2))
    frames = []
    for mode in ("opaque", "mask"):
        material = rj.Material("unlit", "white", base_color_texture=texture, alpha_mode=mode)
        mesh = rj.Mesh(vertices, faces, uv=uv, material=material)
        frames.append(rj.render(mesh, FRONT, size=(150, 140), outputs=OUTPUTS, threads=1))
    assert frames[1].plan.facts.needs_alpha_tests
    same_bits(*frames)


@pytest.mark.needs_jit
def test_the_border_of_the_picture_leaves_no_glass_in_other_samples(stones):
    glass = rj.Material("unlit", (1, 1, 1, 0.5), alpha_mode="blend")
    frame = rj.render(
        rj.Mesh(*stones, material=glass), FRONT, size=(150, 140), outputs="linear", threads=1,
        quality=rj.Quality(samples=4), background="transparent",
    )  # fmt: skip
    assert (frame.linear[..., 3] == 0.5).all()


# The exact twin

LAYOUTS = {
    "nearest": ([(2.25, 3.5), (140.5, 8.25), (61.75, 90.0)], [1.0, 8.0, 2.0]),
    "bilinear": ([(-20.0, 10.0), (170.0, -5.0), (30.0, 130.0)], [4.0, 4.0, 1.0]),
    "trilinear": ([(2.25, 3.5), (140.5, 8.25), (61.75, 90.0)], [1.0, 16.0, 2.0]),
}


@pytest.mark.parametrize("kind", LAYOUTS)
def test_masked_triangles_equal_the_twin_that_drops_samples(kind):
    pixels = np.ones((6, 7, 4), np.float32)
    pixels[..., 3] = np.random.default_rng(3).random((6, 7))
    texture = rj.Texture(pixels, filter=kind, wrap=("mirror", "repeat"))
    rng = np.random.default_rng(4)
    triangles, ws = [LAYOUTS[kind][0]], [LAYOUTS[kind][1]]
    for _ in range(7):
        extent = rng.choice([6.0, 30.0, 90.0])
        middle = rng.uniform((0, 0), SIZE)
        triangles.append((middle + rng.uniform(-extent, extent, (3, 2))).tolist())
        ws.append(rng.uniform(1.0, 9.0, 3).tolist())
    # Binary fractions: exact in float32 and in the twin.
    triangles = (np.round(np.array(triangles) * 64) / 64).tolist()
    ws = (np.round(np.array(ws) * 64) / 64).tolist()
    uvs = (np.round(rng.uniform(-2.0, 2.0, (len(ws), 3, 2)) * 64) / 64).tolist()
    meshes = [
        rj.Mesh(corners_of(points, w), [(0, 1, 2)]) for points, w in zip(triangles, ws, strict=True)
    ]
    depth, shown, closest = naive.cut(
        meshes, clip_camera(), SIZE, triangles, ws, texture, uvs, 0.45
    )
    # No sample of the twin is so near to the cutoff that float32 decides.
    assert closest > 2e-6
    mesh = rj.Mesh(
        np.concatenate([m.vertices for m in meshes]), np.arange(24).reshape(8, 3),
        uv=np.concatenate(uvs), material=masked(texture, 0.45),
    )  # fmt: skip
    whole = naive.visibility(rj.Mesh(mesh.vertices, mesh.faces), clip_camera(), SIZE)
    assert (whole[1] != shown).sum() > 1000
    for threads in (1, 3):
        engine = naive.visibility(mesh, clip_camera(), SIZE, threads)
        assert (engine[1] == shown).all()
        assert engine[0].tobytes() == depth.tobytes()


def test_clipped_faces_have_the_holes_of_whole_ones():
    camera = rj.PerspectiveCamera(eye=(0, 1, 0), target=(0, 0.6, -2), fov_y=60.0, near=0.1)

    def floor(near):
        corners = [(-40, 0, near), (40, 0, near), (40, 0, -60), (-40, 0, -60)]
        uv = [(x / 4, -z / 4) for x, _, z in corners]
        material = masked(rj.Texture(CHECKER, filter="nearest"))
        mesh = rj.Mesh(corners, [(0, 1, 2), (0, 2, 3)], uv=uv, material=material)
        return rj.render(mesh, camera, size=SIZE, outputs=("face_id", "uv"), threads=1)

    whole, clipped = floor(-0.25), floor(20.0)
    assert clipped.stats.clipped > 0
    assert whole.stats.clipped == 0
    plain = rj.render(
        rj.Mesh([(-40, 0, 20), (40, 0, 20), (40, 0, -60), (-40, 0, -60)], [(0, 1, 2), (0, 2, 3)],
                uv=[(-10, -5), (10, -5), (10, 15), (-10, 15)]),
        camera, size=SIZE, outputs=("face_id", "uv"), threads=1,
    )  # fmt: skip
    # Where its own uv output leads is where the checker decides.
    texel = np.floor(plain.uv * 8)
    is_there = (plain.face_id >= 0) & ((texel[..., 0] + 7 - texel[..., 1]) % 2 == 1)
    assert is_there.sum() > 1000
    assert ((clipped.face_id >= 0) == is_there).all()
    # A clipped vertex is not snapped: only samples on the border of a texel may differ.
    differ = ((clipped.face_id >= 0) != (whole.face_id >= 0))[np.isfinite(whole.uv[..., 0])]
    assert differ.mean() < 0.02


# What is seen through holes


def test_what_lies_behind_is_seen_through_holes():
    front = square(rj.Texture(CHECKER, filter="nearest"), box((0, 0), (1, 1)))
    front.material = masked(front.material.base_color_texture)
    back = rj.Mesh(front.vertices * (1.2, 1.2, 1) - (0, 0, 1), front.faces)
    scene, lone = rj.Scene(), rj.Scene()
    scene.add(front)
    scene.add(back)
    lone.add(back)
    options = {"size": (160, 160), "outputs": ("object_id", "depth", "face_id"), "threads": 1}
    both, alone = (rj.render(s, FRONT, **options) for s in (scene, lone))
    expected = np.kron((CHECKER[..., 3] == 0.0).astype(int), np.ones((20, 20), int))
    assert (both.object_id == expected).all()
    behind = both.object_id == 1
    assert (both.depth[behind] == alone.depth[behind]).all()
    assert (both.face_id[behind] == alone.face_id[behind] + 2).all()
    # Whichever comes first.
    scene.nodes.reverse()
    turned = rj.render(scene, FRONT, **options)
    assert (turned.object_id == 1 - both.object_id).all()
    assert (turned.depth == both.depth).all()


@pytest.mark.needs_jit
def test_faces_with_holes_hide_no_tile():
    # Large triangles over whole tiles hide what is behind them; not those with holes.
    pixels = np.ones((64, 64, 4), np.float32)
    pixels[20:30, 20:30, 3] = 0.0
    size = (512, 512)
    front = square(rj.Texture(pixels, filter="nearest"), box((0, 0), (1, 1)))
    faces = {}
    for mode in ("opaque", "mask"):
        front.material = rj.Material(
            "unlit", "white", alpha_mode=mode, base_color_texture=front.material.base_color_texture
        )
        scene = rj.Scene()
        scene.add(front)
        scene.add(rj.Mesh(front.vertices - (0, 0, 1), front.faces))
        faces[mode] = rj.render(scene, FRONT, size=size, outputs="object_id", threads=1).object_id
    assert (faces["opaque"] == 0).all()
    assert (faces["mask"][160:240, 160:240] == 1).all()
    assert (faces["mask"] == 1).sum() == 80 * 80


def test_holes_stay_hidden_behind_what_is_opaque():
    scene = rj.Scene()
    front = rj.Mesh([(-1, -1, 0.5), (1, -1, 0.5), (1, 1, 0.5), (-1, 1, 0.5)],
                    [(0, 1, 2), (0, 2, 3)])  # fmt: skip
    back = square(rj.Texture(CHECKER, filter="nearest"), box((0, 0), (1, 1)))
    back.material = masked(back.material.base_color_texture)
    scene.add(back)
    scene.add(front)
    shown = rj.render(scene, FRONT, size=(256, 256), outputs="object_id", threads=1).object_id
    assert (shown == 1).all()


# What alpha is made of


@pytest.mark.parametrize("cutoff", [0.25, 0.5, 0.75])
def test_the_alpha_of_vertices_is_interpolated(cutoff):
    colors = np.ones((4, 4))
    colors[[0, 3], 3] = 0.0
    mesh = rj.Mesh(
        [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)], colors=colors,
        material=masked(cutoff=cutoff),
    )  # fmt: skip
    shown = covered(mesh, (64, 16))
    alpha = (np.arange(64) + 0.5) / 64
    assert (shown == (alpha >= cutoff)).all()


def test_the_alphas_of_material_faces_and_texture_are_multiplied():
    pixels = np.ones((2, 1, 4), np.float32)
    pixels[1, 0, 3] = 0.5
    texture = rj.Texture(pixels, filter="nearest")
    for alpha, cutoff, shown in ((1.0, 0.5, 3), (0.5, 0.5, 1), (0.5, 0.25, 3), (0.5, 0.125, 4)):
        mesh = rj.Mesh(
            [(-1, -1, 0), (0, -1, 0), (0, 1, 0), (-1, 1, 0), (1, -1, 0), (1, 1, 0)],
            [(0, 1, 2), (0, 2, 3), (1, 4, 5), (1, 5, 2)],
            colors=[(1, 1, 1, 1), (1, 1, 1, 1), (1, 1, 1, 0.5), (1, 1, 1, 0.5)],
            uv=[(0, 0), (0, 0), (0, 1), (0, 1), (0, 0), (0, 1)],
            material=masked(texture, cutoff, base_color=(1, 1, 1, alpha)),
        )  # fmt: skip
        # Quarters: upper left 1, upper right and lower left 0.5, lower right 0.25, times alpha.
        quarters = covered(mesh, (2, 2))
        assert quarters.sum() == shown
        assert quarters[0, 0]


def test_an_alpha_at_the_cutoff_is_covered():
    for cutoff, alpha in ((0.1, 0.1), (0.3, 0.3), (1.0, 1.0), (1.5, 1.0), (0.0, 0.0)):
        mesh = rj.Mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(0, 1, 2)],
                       material=masked(cutoff=cutoff, base_color=(1, 1, 1, alpha)))  # fmt: skip
        assert covered(mesh, (8, 8)).any() == (cutoff <= alpha)


def test_other_objects_and_modes_have_no_holes():
    texture = rj.Texture(CHECKER, filter="nearest")
    scene = rj.Scene()
    for n, mode in enumerate(("opaque", "mask", "opaque")):
        material = rj.Material("unlit", "white", base_color_texture=texture, alpha_mode=mode)
        mesh = square(texture, box((0, 0), (1, 1)))
        mesh.material = material
        scene.add(mesh, rj.transforms.translate((2 * n - 2, 0, 0)))
    camera = rj.OrthographicCamera(eye=(0, 0, 5), target=(0, 0, 0), height=2.0)
    shown = rj.render(scene, camera, size=(96, 32), outputs="object_id", threads=1).object_id
    assert (shown[:, :32] == 0).all()
    assert (shown[:, 64:] == 2).all()
    assert sorted(np.unique(shown[:, 32:64])) == [-1, 1]


# Samples beside the centre


def random_geometry(is_clipped):
    rng = np.random.default_rng(9)
    w = rng.uniform(0.5, 4.0, 3)
    xy = rng.integers(0, 60 * 256, (3, 2)).astype(np.int32)
    ndc = xy / 256.0 / (64.0, 48.0) * (2, -2) + (-1, 1)
    clip = np.column_stack([ndc * w[:, np.newaxis], w, w])
    codes = np.full(3, CLIPPED if is_clipped else 0, np.uint8)
    viewport = Viewport(64, 48, 2.0, 2.0, 8, 8)
    return Geometry(np.int32([[0, 1, 2]]), xy, codes, w, clip, viewport)


@pytest.mark.parametrize("is_clipped", [False, True])
def test_weights_of_samples(is_clipped):
    geometry = random_geometry(is_clipped)
    middle = geometry.xy.mean(axis=0) / 256
    column, row = int(middle[0]), int(middle[1])
    centre = barycentric.compute_sample_weights(0, 1, 2, column, row, geometry)
    assert barycentric.compute_shifted_weights(0, 1, 2, column, row, (0, 0), geometry) == centre
    # Moving the vertices one way is moving the sample the other way.
    for shift in ((-96, 32), (127, -128)):
        moved = geometry.xy + np.int32(shift)
        ndc = moved / 256.0 / (64.0, 48.0) * (2, -2) + (-1, 1)
        clip = np.column_stack([ndc * geometry.w[:, np.newaxis], geometry.w, geometry.w])
        there = geometry._replace(xy=moved.astype(np.int32), clip_positions=clip)
        expected = barycentric.compute_sample_weights(0, 1, 2, column, row, there)
        found = barycentric.compute_shifted_weights(0, 1, 2, column, row, shift, geometry)
        assert np.abs(np.subtract(found, expected)).max() < 1e-12
        assert np.abs(np.subtract(found, centre)).max() > 1e-3


# With what else there is


def test_holes_show_under_a_transparent_surface():
    front = square(rj.Texture(CHECKER, filter="nearest"), box((0, 0), (1, 1)))
    front.material = masked(front.material.base_color_texture)
    glass = rj.Mesh(front.vertices + (0, 0, 1), front.faces,
                    material=rj.Material("unlit", (0, 0, 0, 0.5), alpha_mode="blend"))  # fmt: skip
    back = rj.Mesh(front.vertices - (0, 0, 1), front.faces, material=rj.Material("unlit", "red"))
    scene = rj.Scene()
    for mesh in (glass, front, back):
        scene.add(mesh)
    shown = rj.render(scene, FRONT, size=(80, 80), outputs="linear", threads=1).linear
    hole = np.kron(CHECKER[..., 3] == 0.0, np.ones((10, 10), bool))
    assert (shown[hole] == np.float32([0.5, 0, 0, 1])).all()
    assert (shown[~hole] == np.float32([0.5, 0.5, 0.5, 1])).all()


def test_every_sample_of_a_pixel_has_its_own_hole():
    pixels = np.ones((1, 2, 4), np.float32)
    pixels[0, 1, 3] = 0.0
    half = square(rj.Texture(pixels, filter="nearest"), box((0, 0), (1, 1)))
    half.material = masked(half.material.base_color_texture)
    scene = rj.Scene()
    scene.add(half, rj.transforms.scale((5, 1, 1)))
    # The hole begins in the middle of the third column: two samples of four lie left of it.
    frame = rj.render(
        scene, FRONT, size=(5, 1), outputs=("linear", "face_id"), background="transparent",
        quality=rj.Quality(samples=4), threads=1,
    )  # fmt: skip
    assert frame.linear[0, :, 3].tolist() == [1, 1, 0.5, 0, 0]
    assert (frame.face_id[0] >= 0).tolist() == [True, True, False, False, False]


@pytest.mark.needs_jit
def test_a_pixel_says_what_is_cut_out():
    front = square(rj.Texture(CHECKER, filter="nearest"), box((0, 0), (1, 1)))
    front.material = masked(front.material.base_color_texture)
    scene = rj.Scene()
    scene.add(front)
    scene.add(rj.Mesh(front.vertices - (0, 0, 1), front.faces))
    through = rj.explain_pixel(scene, FRONT, (80, 80), 5, 5)
    assert [(face.face, face.standing) for face in through.faces] == [
        (3, "visible"), (1, "cut out"),
    ]  # fmt: skip
    solid = rj.explain_pixel(scene, FRONT, (80, 80), 15, 5)
    assert [face.standing for face in solid.faces] == ["visible", "hidden"]
    scene.nodes.pop()
    nothing = rj.explain_pixel(scene, FRONT, (80, 80), 5, 5)
    assert nothing.winner is None
    assert "cut out faces cover it: 1" in nothing.reasons


# The plan


def test_masks_are_planned_where_alpha_can_be_below_the_cutoff():
    texture = rj.Texture(CHECKER)
    mesh = square(texture, box((0, 0), (1, 1)))

    def row(material, **options):
        mesh.material = material
        plan = rj.explain(mesh, FRONT, **options)
        (effect,) = [effect for effect in plan.effects if effect.name == "alpha masks"]
        assert effect.used == plan.facts.needs_alpha_tests
        return effect.used, effect.reason

    assert row(rj.Material("unlit")) == (False, "no material has the alpha_mode 'mask'")
    none = (False, "no alpha of an object with a mask is below its alpha_cutoff")
    assert row(masked(texture, 0.0)) == none
    assert row(masked(rj.Texture(np.ones((2, 2))))) == none
    assert row(masked(base_color=(1, 1, 1, 0.5))) == none
    some = (True, "1 of 1 objects with a mask can have holes")
    assert row(masked(texture)) == some
    assert row(masked(base_color=(1, 1, 1, 0.4))) == some
    assert row(masked(texture), outputs="depth") == some


def test_a_mask_without_uv_is_refused_by_the_name_of_its_node():
    scene = rj.Scene()
    scene.add(rj.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)],
                      material=masked(rj.Texture(CHECKER))), name="fern")  # fmt: skip
    for outputs in ("color", "depth"):
        with pytest.raises(ValueError, match=r"mesh of 'fern' must have uv, .*base_color_texture"):
            rj.render(scene, FRONT, size=(4, 4), outputs=outputs)
