"""Recolour the meshes of scenes."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rasterjit.scene.camera import Camera
from rasterjit.scene.colormap import Colormap
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import TEXTURE_FIELDS, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import unit_rows
from rasterjit.scene.points import Points
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import Anisotropy, Texture
from rasterjit.scene.vectors import dot
from rasterjit.survey.posing import posed_scene

NEAR_TO_FAR = Colormap(np.repeat(np.arange(246, 51, -1, dtype=np.uint8)[:, None], 3, axis=1))
"""Greys of depths, the nearest first; the farthest is told apart from black."""

UNLIT = Material(shading="unlit")

ALL_KINDS = (Mesh, Points, Lines)

SMOOTH = ("phong", "gouraud", "pbr")
"""Shadings by normals of vertices."""


def repainted(
    scene: Scene, paint: Callable[[Node], Mesh], kinds: tuple[type[Mesh], ...] = (Mesh,)
) -> Scene:
    """
    Return a scene, posed, with other meshes; labels stay, and points and lines unless named.

    Parameters
    ----------
    scene : Scene
    paint : callable
        Returns the mesh that is drawn for a node of these kinds.
    kinds : tuple of type
    """
    scene = posed_scene(scene)
    changed = copy.copy(scene)
    changed.nodes = [
        Node(paint(node), node.world_matrix, node.name) if type(node.mesh) in kinds else node
        for node in scene.nodes
    ]
    return changed


def covered(scene: Scene, material: Material) -> Scene:
    """Return a scene whose triangles all have one material, and no colours of their own."""
    painted: dict[int, Mesh] = {}

    def paint(node: Node) -> Mesh:
        if id(node.mesh) not in painted:
            mesh = painted[id(node.mesh)] = node.mesh.without_colors()
            mesh.material = _as_seen(node.mesh, material)
        return painted[id(node.mesh)]

    return repainted(scene, paint)


def _as_seen(mesh: Mesh, material: Material) -> Material:
    """Return a material whose back faces are drawn where those of a mesh are."""
    return replace(material, double_sided=mesh.material.double_sided)


def sharpened(scene: Scene, anisotropy: Anisotropy) -> Scene:
    """
    Return a scene whose trilinear textures stay sharp aslant; itself where there are none.

    Textures of other filters and of an anisotropy of their own stay as they are.
    """
    meshes: dict[int, Mesh] = {}
    textures: dict[Texture, Texture] = {}
    for node in scene.nodes:
        mesh = node.mesh
        if type(mesh) is not Mesh or id(mesh) in meshes:
            continue
        changes: dict[str, Any] = {}
        for name in TEXTURE_FIELDS:
            texture = getattr(mesh.material, name)
            if texture is None or texture.filter != "trilinear" or texture.anisotropy > 1:
                continue
            if texture not in textures:
                textures[texture] = texture.with_filter("trilinear", anisotropy)
            changes[name] = textures[texture]
        if changes:
            sharp = meshes[id(mesh)] = copy.copy(mesh)
            sharp.material = replace(mesh.material, **changes)
    if not meshes:
        return scene
    changed = copy.copy(scene)
    changed.nodes = [
        Node(meshes[id(node.mesh)], node.world_matrix, node.name)
        if id(node.mesh) in meshes
        else node
        for node in scene.nodes
    ]
    return changed


def painted_by_depth(scene: Scene, camera: Camera) -> Scene:
    """Return a scene whose objects show how far along the viewing axis they lie."""
    scene, row = posed_scene(scene), camera.view_matrix()[2].tolist()
    depths, low, high = {}, np.inf, -np.inf
    for node in scene.nodes:
        if type(node.mesh) not in ALL_KINDS:
            continue
        matrix, positions = node.world_matrix, node.mesh.vertices
        x, y, z, w = (dot(row, column) for column in matrix[:3].T.tolist())
        w += row[3]
        # Vertices of no face may be infinite.
        with np.errstate(over="ignore", invalid="ignore"):
            away = -(((positions[:, 0] * x + positions[:, 1] * y) + positions[:, 2] * z) + w)
        depths[id(node)] = away
        ahead = away[(away > 0.0) & node.mesh.used_vertices()]
        if len(ahead):
            low, high = min(low, float(ahead.min())), max(high, float(ahead.max()))
    if not low < high:
        low, high = 0.0, 1.0

    def paint(node: Node) -> Mesh:
        # Shares, for scalars are float32: of distances that has too few digits, or no room.
        shares = (np.clip(depths[id(node)], low, high) - low) / (high - low)
        mesh = node.mesh.with_scalars(shares, NEAR_TO_FAR, range=(0.0, 1.0))
        mesh.material = _as_seen(node.mesh, UNLIT)
        return mesh

    return repainted(scene, paint, ALL_KINDS)


def painted_by_normal(scene: Scene) -> Scene:
    """Return a scene whose triangles show their normals: red x, green y, blue z, world space."""

    def paint(node: Node) -> Mesh:
        mesh = node.mesh
        matrix = node.world_matrix[:3, :3]
        positions, faces = mesh.vertices, mesh.faces
        if mesh.normals is not None or mesh.material.shading in SMOOTH:
            normals = mesh.vertex_normals().astype(np.float64)
        else:
            # Each face has vertices of its own.
            positions, faces = positions[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
            a, b, c = (positions[k::3] for k in range(3))
            normals = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        # The cofactors turn normals as the matrix turns surfaces.
        rows = np.stack([np.cross(matrix[(k + 1) % 3], matrix[(k + 2) % 3]) for k in range(3)])
        x, y, z = normals.T
        turned = np.stack([(x * r[0] + y * r[1]) + z * r[2] for r in rows], axis=1)
        if dot(matrix[0].tolist(), rows[0].tolist()) < 0.0:
            turned = -turned
        colors = np.clip(np.floor(unit_rows(turned) * 127.5 + 128.0), 0.0, 255.0).astype(np.uint8)
        return Mesh(
            positions, faces, colors=colors, on_invalid="drop", material=_as_seen(mesh, UNLIT)
        )

    return repainted(scene, paint)
