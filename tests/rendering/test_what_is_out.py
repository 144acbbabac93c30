"""
What a plan calls out changes no bit, nor how a mesh is written: its parts, numbers, order, copies.

Scenes are drawn at random, from a seed that changes from run to run and is printed.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import random_scenes as scenes

import rasterjit as rj
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.rendering.regions import Region, RegionRenderer

FEW, MANY = 25, 1200
"""Scenes of a quick run, and of a long one."""


UNASKED = (
    "diagnostics", "labels", "section", "section hatching", "section lines", "hidden lines",
)  # fmt: skip
"""Rows that are in if they are asked for: planes may cut nothing, labels lie behind the eye."""


@pytest.fixture(params=[FEW, pytest.param(MANY, marks=pytest.mark.takes_long)])
def randoms(request):
    """Generators, one for each scene, with their seeds."""
    seed = scenes.seed_of_run()
    return [(f"{seed}, scene {n}", np.random.default_rng([seed, n])) for n in range(request.param)]


def used(plan):
    return [one.name for one in plan.planned]


def copied(scene):
    """Return a scene with lists of its own."""
    twin = copy.copy(scene)
    twin.nodes, twin.lights = list(scene.nodes), list(scene.lights)
    twin._labelled = dict(scene._labelled)
    return twin


def draw(random, scene, camera, **options):
    """Draw a scene in one of the ways that there are; all have the bits of `rasterjit.render`."""
    way = str(random.choice(["lone", "kept", "batch", "region"]))
    size, quality, outputs = options["size"], options["quality"], options["outputs"]
    plain = set(options) == {"size", "quality", "outputs"}
    if way == "kept":
        with rj.Renderer(size, quality=quality) as renderer:
            other = copied(scene)
            other.lights = []
            renderer.render(other, camera, outputs=outputs)
            return arrays_of(renderer.render(scene, camera, **rest_of(options)))
    if way == "batch" and plain:
        cameras = [scenes.random_camera(random), camera]
        batch = rj.render_batch(scene, cameras, size=size, quality=quality, outputs=outputs)
        return {name: np.array(values[1]) for name, values in batch.arrays().items()}
    if way == "region" and plain:
        return in_regions(scene, camera, options)
    return arrays_of(rj.render(scene, camera, **options))


def in_regions(scene, camera, options):
    """Draw a scene in two parts, if nothing looks from one to the other."""
    try:
        renderer = RegionRenderer(scene, camera, **options)
        if renderer.plan.has("shadows"):
            raise ValueError
    except ValueError:
        return arrays_of(rj.render(scene, camera, **options))
    height, parts = options["size"][1], []
    with renderer:
        for left, width in ((0, 64), (64, 8)):
            parts.append(arrays_of(renderer.render_region(Region(left, 0, width, height))))
    return {name: np.concatenate([part[name] for part in parts], axis=1) for name in parts[0]}


def rest_of(options):
    return {name: value for name, value in options.items() if name not in ("size", "quality")}


def arrays_of(frame):
    return {name: np.array(values) for name, values in frame.arrays().items()}


def differing(one, other, to_one=scenes.NUMBERS):
    """Return the outputs that differ; numbers of things may be others, one for each."""
    found = []
    for name in one:
        a, b = one[name], other[name]
        if name not in to_one:
            if a.tobytes() != b.tobytes():
                found.append((name, int((a != b).reshape(*a.shape[:2], -1).any(-1).sum())))
            continue
        pairs = np.unique(np.stack([a.ravel(), b.ravel()]), axis=1)
        # Several new numbers may stand for one old one: parts of a mesh.
        if (
            len({*pairs[0].tolist()}) != pairs.shape[1]
            or ((pairs < 0).any(0) != (pairs < 0).all(0)).any()
        ):
            found.append((name, pairs.T.tolist()[:9]))
    return found


@pytest.mark.filterwarnings("ignore")
def test_what_is_out_changes_no_bit(randoms):
    tried = set()
    for seed, random in randoms:
        outputs = scenes.random_outputs(random)
        quality = scenes.perhaps_codes(random, scenes.random_quality(random))
        has_shadows, sees_through = scenes.chance(random, 0.2), quality.samples != "area"
        scene = scenes.random_scene(random, has_shadows, sees_through=sees_through)
        camera = scenes.random_camera(random)
        if scenes.chance(random, 0.15):
            outputs = tuple(name for name in outputs if name not in ("color", "linear")) or (
                "depth",
            )
        options = {"size": scenes.SIZE, "quality": quality, "outputs": outputs}
        before = rj.render(scene, camera, **options)
        names = [str(name) for name in random.choice([*scenes.OUT], random.integers(1, 4))]
        more, added = copied(scene), dict(options)
        told = []
        for name in names:
            told += add_in_vain(random, name, before.plan, more, camera, added)
        after = used(rj.explain(more, camera, **added))
        changed = {*after} ^ {*used(before.plan)}
        is_wide = isinstance(camera, rj.OrthographicCamera) or scene.section is not None
        if is_wide and not changed.issubset(UNASKED):
            # Beyond planes of a parallel projection, and cut away, things may count as in view.
            continue
        assert changed.issubset(UNASKED), (seed, told, changed, quality.samples)
        found = differing(arrays_of(before), draw(random, more, camera, **added))
        assert not found, (seed, found, told, after, quality)
        tried |= {*names}
    assert len(randoms) < MANY or tried == {*scenes.OUT}


def add_in_vain(random, name, plan, scene, camera, options):
    """Add what asks for a row of the effects' table in vain; return what that was."""
    adders = scenes.OUT[name]
    if not adders:
        changes = scenes.arguments_in_vain(random, options["outputs"]).get(name, {})
        if any(isinstance(node.mesh, rj.Points) for node in scene.nodes):
            # Round ones are not diagnosed.
            return []
        quality = replace(options["quality"], **changes.pop("quality", {}))
        options |= {**changes, "quality": quality}
        return [name]
    add = adders[random.integers(len(adders))]
    if getattr(add, "asks_for_no_color", False) and plan.facts.is_colored:
        return []
    if plan.has("shadows") and adds_meshes(add):
        # What is out of view may cast shadows into it.
        return []
    if "diagnose" in options and add in scenes.OUT["shading"]:
        return []
    if name == "transparency" and options["quality"].samples == "area":
        # It is refused, in view or not.
        return []
    add(random, scene, camera)
    return [f"{name}: {getattr(add, '__qualname__', add)}"]


def adds_meshes(add):
    return add in scenes.OUT["shading"] or "with_" in add.__qualname__


def test_every_row_has_something_that_is_out():
    assert [*scenes.OUT] == [one.name for one in EFFECTS]
    random = np.random.default_rng(1)
    arguments = scenes.arguments_in_vain(random, ("depth",))
    assert {name for name, adders in scenes.OUT.items() if not adders} == {*arguments}


# How a mesh is written


class Written:
    """The arrays that a mesh is made of: of vertices, of faces, and its other arguments."""

    def __init__(self, mesh):
        # Normals and tangents are given: those made of faces are sums, which have an order.
        self.faces = np.array(mesh.faces)
        self.of_vertices = {
            "vertices": np.array(mesh.vertices), "normals": mesh.vertex_normals(), "uv": mesh.uv,
            "tangents": mesh.vertex_tangents()[:, 0],
        }  # fmt: skip
        self.of_faces, self.others = {}, {"material": mesh.material}
        if mesh.vertex_colors is not None:
            self.of_vertices["colors"] = mesh.vertex_colors
        elif mesh.face_colors is not None:
            self.of_faces["colors"] = mesh.face_colors
        elif mesh.vertex_field is not None:
            self.of_vertices["scalars"] = mesh.vertex_field.values
            self.others |= {"range": (0.0, 1.0), "contours": mesh.vertex_field.contours}

    def mesh(self):
        count = len(self.of_vertices["vertices"])
        if self.of_faces and count == len(self.faces):
            # Else colours of faces are taken for those of vertices.
            return self.of(np.append(np.arange(count), 0), self.faces).mesh()
        return rj.Mesh(faces=self.faces, **self.of_vertices, **self.of_faces, **self.others)

    def of(self, sources, faces):
        """Return one of vertices that are taken from these by number."""
        made = copy.copy(self)
        made.faces = faces
        made.of_vertices = {name: rows[sources] for name, rows in self.of_vertices.items()}
        return made

    def part(self, chosen):
        """Return one of some of the faces."""
        made = copy.copy(self)
        made.faces = self.faces[chosen]
        made.of_faces = {name: rows[chosen] for name, rows in self.of_faces.items()}
        return made

    def parts(self, random):
        """Return three of a third of the faces each, or fewer: neighbours, or mixed."""
        cut = random.integers(0, 3, len(self.faces))
        if scenes.chance(random, 0.5):
            cut.sort()
        return [self.part(cut == n) for n in range(3) if (cut == n).any()]

    def otherwise(self, random):
        """Return one with other vertices of the same values, its faces spelled otherwise."""
        count, way = len(self.of_vertices["vertices"]), random.integers(4)
        made = self
        if way == 0:
            made = self.of(self.faces.ravel(), np.arange(self.faces.size).reshape(-1, 3))
        elif way == 1:
            order = random.permutation(count)
            made = self.of(order, np.argsort(order)[self.faces])
        elif way == 2:
            # Vertices that no face has, far away.
            made = self.of(np.append(np.zeros(7, int), np.arange(count)), self.faces + 7)
            made.of_vertices["vertices"][:7] += 50.0 * random.normal(size=3)
        made = copy.copy(made)
        if scenes.chance(random, 0.3):
            made.faces = np.array([np.roll(face, random.integers(3)) for face in made.faces])
        if scenes.chance(random, 0.3):
            made.others = {**made.others, "material": replace(made.others["material"])}
        return made


@pytest.mark.filterwarnings("ignore")
def test_how_a_mesh_is_written_changes_no_bit(randoms):
    for seed, random in randoms:
        quality = scenes.perhaps_codes(random, scenes.random_quality(random))
        scene = scenes.random_scene(random, sees_through=quality.samples != "area")
        camera = scenes.random_camera(random)
        # Lines between objects, and edges that two parts share, are drawn as they are cut; weights
        # are named by corner, and the corners are renamed.
        # New vertices of cut faces, and sums over several faces, follow the numbers of both.
        scene.outline = scene.wireframe = scene.section = None
        keeps_faces = quality.samples != 1 or scenes.chance(random, 0.3)
        outputs = {*scenes.random_outputs(random)} - {"barycentric"} or {"depth"}
        options = {"size": scenes.SIZE, "quality": quality, "outputs": tuple(sorted(outputs))}
        one, other = copied(scene), copied(scene)
        one.nodes, other.nodes, added = [], [], []
        for node in scene.nodes:
            written, place = Written(node.mesh), node.world_matrix
            one.add(written.mesh(), place)
            is_cut = not keeps_faces and scenes.chance(random, 0.7)
            parts = written.parts(random) if is_cut else [written]
            added += [(part.otherwise(random).mesh(), place) for part in parts]
        if not keeps_faces and scenes.chance(random, 0.4):
            added = [added[n] for n in random.permutation(len(added))]
        for mesh, place in added:
            other.add(mesh, place)
        before = arrays_of(rj.render(one, camera, **options))
        after = draw(random, other, camera, **options)
        found = differing(after, before)
        if found and not keeps_faces:
            # Where depths are equal, the lower number wins, and cut meshes have other numbers.
            tied = pixels_with_ties(one, camera, quality)
            assert tied.sum() < FEW, (seed, found, tied.nonzero())
            before, after = (
                {n: a[~tied][None] for n, a in arrays.items()} for arrays in (before, after)
            )
            found = differing(after, before)
        assert not found, (seed, found, used(rj.explain(other, camera, **options)), quality)


def pixels_with_ties(scene, camera, quality):
    """Return (H, W), whether two faces at a pixel's centre have the same stored depth."""
    tied = np.zeros(scenes.SIZE[::-1], bool)
    for y, x in np.ndindex(tied.shape):
        faces = rj.explain_pixel(scene, camera, scenes.SIZE, x, y, quality=quality).faces
        tied[y, x] = len({face.stored_depth for face in faces}) < len(faces)
    return tied
