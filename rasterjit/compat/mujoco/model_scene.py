"""Convert the geoms and lights that MuJoCo lists for its renderers to a scene."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from rasterjit.compat.mujoco import shapes
from rasterjit.compat.opengl_camera import make_matrix_camera
from rasterjit.compat.unit_shapes import Triangulation, make_unit_shape
from rasterjit.scene.camera import MatrixCamera
from rasterjit.scene.color import decoding_table
from rasterjit.scene.light import (
    AmbientLight,
    DirectionalLight,
    Light,
    PointLight,
    Shadow,
    SpotLight,
)
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import AlphaMode, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import Texture
from rasterjit.scene.validation import brief, read_only
from rasterjit.scene.vectors import cross, dot, length
from rasterjit.scene.warning import warn_caller

Float64 = NDArray[np.float64]

GEOM, FLAG, LIGHT = mujoco.mjtGeom, mujoco.mjtRndFlag, mujoco.mjtLightType

SCALED_PARTS = {
    GEOM.mjGEOM_SPHERE: ("ball",), GEOM.mjGEOM_ELLIPSOID: ("ball",),
    GEOM.mjGEOM_CAPSULE: ("tube", "top", "bottom"), GEOM.mjGEOM_CYLINDER: ("cylinder",),
    GEOM.mjGEOM_BOX: ("box",), GEOM.mjGEOM_ARROW: ("arrow",), GEOM.mjGEOM_ARROW1: ("arrow1",),
    GEOM.mjGEOM_ARROW2: ("arrow2",), GEOM.mjGEOM_TRIANGLE: ("triangle",),
    GEOM.mjGEOM_LINE: ("line",), GEOM.mjGEOM_LINEBOX: ("line box",),
}  # fmt: skip
"""Names of the parts of geoms whose size scales their shape."""

UNSCALED_KINDS = (
    GEOM.mjGEOM_PLANE, GEOM.mjGEOM_HFIELD, GEOM.mjGEOM_MESH, GEOM.mjGEOM_SDF, GEOM.mjGEOM_FLEX,
    GEOM.mjGEOM_SKIN,
)  # fmt: skip
"""Kinds of geoms of one part, whose size does not scale it."""

PARTS_BY_KIND = {
    **SCALED_PARTS, **dict.fromkeys(UNSCALED_KINDS, ("",)),
    GEOM.mjGEOM_LABEL: (), GEOM.mjGEOM_NONE: (),
}  # fmt: skip
"""Names of the parts of all known kinds of geoms."""

MIN_OPAQUE_ALPHA = 0.995
"""Least alpha of a geom that MuJoCo draws as opaque."""

BACK_ALPHA_FACTOR = 0.3
"""Factor on the alpha of a plane that is seen from behind."""

MAX_SHADOW_TEXELS = 1024
"""Largest side of a shadow map: ours is fitted to the view, MuJoCo's is not."""

HALF_LIGHT_RAMP = 0.5**0.5
"""Value of a spot light's ramp at half its light: its square is 1/2."""

OBJECT_NAMES = {int(kind): kind.name[6:].lower() for kind in mujoco.mjtObj.__members__.values()}
"""Names of the kinds of objects, by MuJoCo's number."""

UNSUPPORTED_FLAGS = (
    (FLAG.mjRND_WIREFRAME, "wireframes"), (FLAG.mjRND_ADDITIVE, "additive transparency"),
    (FLAG.mjRND_FOG, "fog"), (FLAG.mjRND_SEGMENT, "segments as colours (mjRND_SEGMENT)"),
    (FLAG.mjRND_IDCOLOR, "numbers as colours (mjRND_IDCOLOR)"),
    (FLAG.mjRND_DEPTH, "depth as colours (mjRND_DEPTH)"),
)  # fmt: skip
"""Flags without effect here, and what they ask for."""

STATE_SIZES = (
    "nq", "nv", "nu", "na", "nbody", "njnt", "ngeom", "nsite", "ncam", "nlight", "nmocap", "neq",
    "ntendon", "nwrap", "nsensor", "nmesh", "nskin", "nskinvert", "nflex", "nflexvert",
    "nflexedge", "nflexelem", "nbvh",
)  # fmt: skip
"""Fields of a model on which the arrays of its states depend."""

MIN_SPARE_ITEMS = 16
"""Least number of cached meshes, and of textures, beyond those in use."""

_GEOM_FIELDS = operator.attrgetter(
    "type", "dataid", "objtype", "objid", "matid", "texid", "texcoord", "segid", "emission",
    "specular", "shininess", "reflectance", "texuniform", "category",
)  # fmt: skip
_LIGHT_FIELDS = operator.attrgetter(
    "type", "pos", "dir", "attenuation", "cutoff", "exponent", "ambient", "diffuse", "specular",
    "castshadow",
)  # fmt: skip
_TYPE, _DATA, _OBJECT, _NUMBER, _MATERIAL, _TEXTURE, _HAS_UV, _SEGMENT, _EMISSION = range(9)
_SPECULAR, _SHININESS, _REFLECTANCE, _IS_UNIFORM, _CATEGORY = 9, 10, 11, 12, 13


class GeomArrays:
    """
    Views of the fields of all geoms of a MuJoCo scene, without a copy.

    Parameters
    ----------
    scene : mujoco.MjvScene
        With a capacity of two geoms or more.
    """

    def __init__(self, scene: Any) -> None:
        first, second = scene.geoms[:2]
        self._stride = second.pos.ctypes.data - first.pos.ctypes.data
        self._count, self._first, self._scene = len(scene.geoms), first, scene
        self.pos, self.mat, self.size, self.rgba, self.repeat = (
            self._column(name) for name in ("pos", "mat", "size", "rgba", "texrepeat")
        )

    def _column(self, name: str) -> NDArray[np.float32]:
        first = getattr(self._first, name)
        shape, strides = (self._count, *first.shape), (self._stride, *first.strides)
        return as_strided(first, shape, strides, writeable=False)


class ModelScene(Scene):
    """
    A scene of a model whose nodes follow its geoms; `follow` updates it to a state.

    Parameters
    ----------
    model : mujoco.MjModel
    max_geom : int
        Capacity of MuJoCo's list of geoms.
    as_codes : bool
        Whether light is computed with sRGB codes, as OpenGL does it, for pictures of the output
        ``"linear"``; else colours are decoded first, for those of ``"color"``.
    """

    def __init__(self, model: Any, max_geom: int = 10000, as_codes: bool = False) -> None:
        super().__init__()
        self._model, self._as_codes = model, as_codes
        self._geom_scene = mujoco.MjvScene(model, max(2, max_geom))
        self._option, self._arrays = mujoco.MjvOption(), GeomArrays(self._geom_scene)
        self._surfaces: dict[Any, Triangulation] = {}
        self._meshes: dict[Any, Mesh] = {}
        self._textures: dict[Any, Texture] = {}
        self._whole_textures: dict[int, Texture] = {}
        self._geom_rows: Any = None
        self._appearance: Any = None
        self._light_values: Any = None
        self._shadow_size = MAX_SHADOW_TEXELS
        self._warned: set[str] = set()
        self._owners = np.zeros(0, np.int64)
        self._parts: list[str] = []
        self._matrices = np.zeros((0, 4, 4))

    def follow(self, data: Any, camera: Any = -1, scene_option: Any = None) -> None:
        """
        Update nodes, lights and camera to a state of the simulation.

        Parameters
        ----------
        data : mujoco.MjData
            For which ``mj_forward`` or ``mj_step`` was called.
        camera : int, str or mujoco.MjvCamera
            Of the model by number or name, -1 for the free one: its lights move with it.
        scene_option : mujoco.MjvOption, optional
            Selects what is drawn.

        Raises
        ------
        ValueError
            If there is no such camera, the state is of another model, or an argument is of another
            kind.
        """
        self.list_geoms(data, camera, scene_option)
        self.update()

    def list_geoms(self, data: Any, camera: Any = -1, scene_option: Any = None) -> None:
        """Let MuJoCo list the geoms of a state, for a later `update`."""
        check_state("data", data, self._model)
        option = self._option if scene_option is None else scene_option
        if not isinstance(option, mujoco.MjvOption):
            raise ValueError(f"scene_option must be a mujoco.MjvOption, got {brief(option)}")
        mujoco.mjv_updateScene(
            self._model, data, option, None,
            find_camera(self._model, camera), mujoco.mjtCatBit.mjCAT_ALL.value, self._geom_scene,
        )  # fmt: skip

    def update(self) -> None:
        """Update to MuJoCo's current lists of geoms, lights and cameras, also changed ones."""
        scene = self._geom_scene
        count = scene.ngeom
        rows = [_GEOM_FIELDS(geom) for geom in scene.geoms[:count]]
        if rows != self._geom_rows:
            self._make_nodes(rows)
        self._warn_unsupported(rows)
        self._update_lights(scene)
        arrays, model = self._arrays, self._model
        values = (
            arrays.rgba[:count], self._mark_planes_from_behind(count),
            arrays.size[:count][self._is_sized], arrays.repeat[:count], model.mat_texrepeat,
            model.mat_texuniform,
        )  # fmt: skip
        appearance = self._specular_gain, self._is_culled, *(value.tobytes() for value in values)
        if appearance != self._appearance or self.has_deformed:
            self._appearance = appearance
            self._set_meshes(rows)
        self._place_nodes()

    @property
    def geom_numbers(self) -> NDArray[np.int64]:
        """Index of each node's geom in MuJoCo's list, (O,)."""
        return self._owners

    @property
    def geometry_key(self) -> Any:
        """A key that is equal for two states which differ in poses only."""
        return self._geom_rows, self._appearance

    @property
    def has_deformed(self) -> bool:
        """Whether there are skins or flexible bodies, whose meshes change with the state."""
        return bool(self._is_global.any())

    def list_objects(self) -> list[tuple[int, int] | None]:
        """Return number and type of the object of each node; None for a node without."""
        rows = (self._geom_rows[owner] for owner in self._owners)
        return [(row[_NUMBER], row[_OBJECT]) if row[_SEGMENT] >= 0 else None for row in rows]

    @property
    def matrices(self) -> Float64:
        """``world_from_model`` of the nodes, (O, 4, 4)."""
        return self._matrices

    def make_camera(self, size: tuple[int, int]) -> MatrixCamera:
        """Return the current camera for a picture of a size; before ``mj_forward`` along -z."""
        one, other = self._geom_scene.camera
        camera = mujoco.mjv_averageCamera(one, other)
        forward, up, eye = (part.tolist() for part in (camera.forward, camera.up, camera.pos))
        right = cross(forward, up)
        if not any(right):
            right, forward, up = (1.0, 0.0, 0.0), [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]
        backward = [-part for part in forward]
        view = np.eye(4)
        for row, axis in enumerate((right, cross(right, forward), backward)):
            scale = 1.0 / length(axis)
            axis = [scale * part for part in axis]
            view[row] = *axis, -dot(axis, eye)
        low, high, middle = camera.frustum_bottom, camera.frustum_top, camera.frustum_center
        half = camera.frustum_width or 0.5 * size[0] / size[1] * (high - low)
        near, far, clip = camera.frustum_near, camera.frustum_far, np.zeros((4, 4))
        if camera.orthographic:
            clip[0, [0, 3]] = 1.0 / half, -middle / half
            clip[1, [1, 3]] = 2.0 / (high - low), -(high + low) / (high - low)
            clip[2, 2:] = -2.0 / (far - near), -(far + near) / (far - near)
            clip[3, 3] = 1.0
        else:
            clip[0, [0, 2]] = near / half, middle / half
            clip[1, [1, 2]] = 2.0 * near / (high - low), (high + low) / (high - low)
            clip[2, 2:] = -(far + near) / (far - near), -2.0 * far * near / (far - near)
            clip[3, 2] = -1.0
        return make_matrix_camera(view, clip)

    def find_mirror(self) -> tuple[int, Float64, Float64] | None:
        """Return the index of the mirroring geom, a point and the normal of its plane; or None."""
        scene = self._geom_scene
        if not scene.flags[FLAG.mjRND_REFLECTION]:
            return None
        for n, row in enumerate(self._geom_rows):
            if row[_REFLECTANCE] <= 0.0 or row[_TYPE] not in (GEOM.mjGEOM_PLANE, GEOM.mjGEOM_BOX):
                continue
            if self._arrays.rgba[n, 3] < MIN_OPAQUE_ALPHA:
                continue
            normal = self._arrays.mat[n, :, 2].astype(np.float64)
            height = self._arrays.size[n, 2] if row[_TYPE] == GEOM.mjGEOM_BOX else 0.0
            point = self._arrays.pos[n] + height * normal
            # Only the first such geom mirrors, and only what lies before it.
            return (n, point, normal) if (self._get_eye() - point) @ normal > 0.0 else None
        return None

    # Nodes.

    def _make_nodes(self, rows: list[tuple[Any, ...]]) -> None:
        """Make a node for each part of each geom."""
        self._geom_rows, self._appearance = rows, None
        parts = [
            (n, part) for n, row in enumerate(rows) for part in PARTS_BY_KIND.get(row[_TYPE], ())
        ]
        self._owners = np.array([n for n, _ in parts], np.int64)
        self._parts = [part for _, part in parts]
        kinds = np.array([row[_TYPE] for row in rows], np.int64)[self._owners]
        self._is_cap = np.isin(self._parts, ("top", "bottom"))
        self._cap_sign = np.array([(p == "top") - 1.0 * (p == "bottom") for p in self._parts])
        # Meshes that depend on the size of a geom: by its texture, or as its line width.
        lines = GEOM.mjGEOM_LINE, GEOM.mjGEOM_LINEBOX
        self._is_sized = np.array(
            [row[_MATERIAL] >= 0 or row[_TYPE] in lines for row in rows], np.bool_
        )
        has_data = np.array([row[_DATA] >= 0 for row in rows], np.bool_)[self._owners]
        self._is_scaled = np.isin(kinds, [int(kind) for kind in SCALED_PARTS])
        self._is_flat = ((kinds == GEOM.mjGEOM_PLANE) & ~has_data) | (kinds == GEOM.mjGEOM_TRIANGLE)
        self._is_line = kinds == GEOM.mjGEOM_LINE
        self._is_global = np.isin(kinds, [int(GEOM.mjGEOM_SKIN), int(GEOM.mjGEOM_FLEX)])
        self.nodes[:] = []

    def _set_meshes(self, rows: list[tuple[Any, ...]]) -> None:
        """Set the mesh and material of each node."""
        is_behind = self._mark_planes_from_behind(len(rows))
        meshes = [
            self._get_mesh(int(owner), part, rows[owner], bool(is_behind[owner]))
            for owner, part in zip(self._owners, self._parts, strict=True)
        ]
        if self.nodes:
            for node, mesh in zip(self.nodes, meshes, strict=True):
                if node.mesh is not mesh:
                    node.mesh = mesh
        else:
            for owner, mesh in zip(self._owners, meshes, strict=True):
                self.add(mesh, name=self._get_object_name(rows[owner]))
        for cache in (self._meshes, self._surfaces, self._textures):
            drop_oldest(cache, len(meshes) + max(len(meshes), MIN_SPARE_ITEMS))

    def _get_object_name(self, row: tuple[Any, ...]) -> str:
        """Return the name of a geom's object."""
        # Geoms that a program adds may hold any number.
        if row[_OBJECT] not in OBJECT_NAMES or row[_NUMBER] < 0:
            return "decoration"
        name = mujoco.mj_id2name(self._model, row[_OBJECT], row[_NUMBER])
        return name or f"{OBJECT_NAMES[row[_OBJECT]]} {row[_NUMBER]}"

    def _place_nodes(self) -> None:
        """Move all nodes to the poses of their geoms."""
        owners, arrays = self._owners, self._arrays
        size = arrays.size[owners].astype(np.float64)
        turn, pos = arrays.mat[owners].astype(np.float64), arrays.pos[owners].astype(np.float64)
        scale = np.ones_like(size)
        scale[self._is_scaled] = size[self._is_scaled]
        scale[self._is_flat, :2] = size[self._is_flat, :2]
        scale[self._is_flat, 2] = 1.0
        scale[self._is_line, :2] = 1.0
        scale[self._is_cap, 2] = 0.5 * (size[self._is_cap, 0] + size[self._is_cap, 1])
        matrices = np.zeros((len(owners), 4, 4))
        matrices[:, :3, :3] = turn * scale[:, None, :]
        matrices[:, :3, 3] = pos + turn[:, :, 2] * (self._cap_sign * size[:, 2])[:, None]
        matrices[self._is_global] = np.eye(4)
        matrices[:, 3, 3] = 1.0
        if not np.isfinite(matrices).all():
            raise ValueError("data must hold finite positions, got NaN or infinity in a geom's")
        self._matrices = read_only(matrices)
        for node, matrix in zip(self.nodes, self._matrices, strict=True):
            node._move(matrix, None)

    def _mark_planes_from_behind(self, count: int) -> NDArray[np.bool_]:
        """Mark the geoms that are planes seen from behind, (G,)."""
        arrays = self._arrays
        above = np.einsum(
            "ij,ij->i", self._get_eye() - arrays.pos[:count], arrays.mat[:count, :, 2]
        )
        is_plane = np.array([row[_TYPE] == GEOM.mjGEOM_PLANE for row in self._geom_rows], np.bool_)
        return is_plane & (above < 0.0)

    def _get_eye(self) -> Float64:
        """Return the position between the cameras of both eyes, (3,)."""
        left, right = self._geom_scene.camera
        return 0.5 * (left.pos.astype(np.float64) + right.pos)

    # Meshes and materials.

    def _get_mesh(self, owner: int, part: str, row: tuple[Any, ...], is_behind: bool) -> Mesh:
        """Return the mesh or lines of a part of a geom."""
        kind, arrays = row[_TYPE], self._arrays
        size = tuple(arrays.size[owner].tolist())
        rgba = arrays.rgba[owner].tolist()
        texture, mapping = self._map_texture(owner, row, size)
        look = (
            *rgba, row[_EMISSION], row[_SPECULAR], row[_SHININESS], is_behind, self._specular_gain,
            self._is_culled, texture, row[_CATEGORY],
        )  # fmt: skip
        if kind in (GEOM.mjGEOM_SKIN, GEOM.mjGEOM_FLEX):
            material = self._make_material(rgba, row, texture, is_behind)
            return self._make_deformed_mesh(row, material)
        width = 1.5 if part == "line box" else size[0]
        key = part or kind, row[_DATA], mapping, width if "line" in part else None, look
        if not mark_used(self._meshes, key):
            material = self._make_material(rgba, row, texture, is_behind)
            if "line" in part:
                width *= float(self._model.vis.global_.linewidth)
                self._meshes[key] = _make_lines(part, width, material)
            else:
                self._meshes[key] = self._make_mesh(key[:3], material, is_behind)
        return self._meshes[key]

    def _make_mesh(self, key: tuple[Any, ...], material: Material, is_behind: bool) -> Mesh:
        """Return the mesh of a shape with a material; seen from behind, its faces are turned."""
        part, data, mapping = key
        surface = self._get_surface(part, data)
        if mapping is not None and mapping[0] == "cube":
            if not mark_used(self._surfaces, key):
                self._surfaces[key] = shapes.wrap_in_cube(surface, mapping[1])
            surface = self._surfaces[key]
        elif mapping is not None and mapping[0] == "flat":
            surface = surface._replace(uv=0.5 * surface.positions[:, :2])
        faces = surface.faces[:, ::-1] if is_behind else surface.faces
        uv = surface.uv if material.base_color_texture is not None else None
        return Mesh(surface.positions, faces, normals=surface.normals, uv=uv, material=material)

    def _get_surface(self, part: Any, data: int) -> Triangulation:
        """Return a shape by its name, or by the kind and data number of a geom of the model."""
        key = part, data
        if not mark_used(self._surfaces, key):
            quality = self._model.vis.quality
            if part == GEOM.mjGEOM_PLANE and data >= 0:
                found = shapes.make_plane(self._model, data)
            elif part == GEOM.mjGEOM_HFIELD:
                found = shapes.make_height_field(self._model, data)
            elif part in (GEOM.mjGEOM_MESH, GEOM.mjGEOM_SDF):
                found = shapes.make_mesh(self._model, data)
            else:
                name = part if isinstance(part, str) and part else "square"
                found = make_unit_shape(
                    name, quality.numslices, quality.numstacks, quality.numquads
                )
            self._surfaces[key] = found
        return self._surfaces[key]

    def _make_deformed_mesh(self, row: tuple[Any, ...], material: Material) -> Mesh:
        """Return the mesh of a skin or a flexible body in the current state."""
        scene, model, number, uv = self._geom_scene, self._model, row[_NUMBER], None
        is_textured = material.base_color_texture is not None
        if row[_TYPE] == GEOM.mjGEOM_SKIN:
            first, count = scene.skinvertadr[number], scene.skinvertnum[number]
            points, normals = (
                array[3 * first : 3 * (first + count)].reshape(-1, 3)
                for array in (scene.skinvert.ravel(), scene.skinnormal.ravel())
            )
            start = model.skin_faceadr[number]
            faces = model.skin_face[start : start + model.skin_facenum[number]]
            if is_textured and model.skin_texcoordadr[number] >= 0:
                start = model.skin_texcoordadr[number]
                uv = shapes.flip_v(model.skin_texcoord[start : start + count])
        else:
            start, used = int(scene.flexfaceadr[number]), int(scene.flexfaceused[number])
            own = slice(9 * start, 9 * (start + used))
            points, normals = (
                array.ravel()[own].reshape(-1, 3) for array in (scene.flexface, scene.flexnormal)
            )
            faces = np.arange(3 * used).reshape(-1, 3)
            # Without a texture MuJoCo does not set them.
            if is_textured:
                uv = scene.flextexcoord.ravel()[6 * start : 6 * (start + used)].reshape(-1, 2)
                uv = shapes.flip_v(uv)
        return Mesh(points, faces, normals=normals, uv=uv, material=material)

    def _map_texture(self, owner: int, row: tuple[Any, ...], size: Any) -> tuple[Any, Any]:
        """Return the texture of a geom and the kind of its coordinates, or two None."""
        model, material = self._model, row[_MATERIAL]
        number, is_uniform = row[_TEXTURE], False
        repeat: list[float] = self._arrays.repeat[owner].tolist()
        if number >= 0:
            is_uniform = bool(row[_IS_UNIFORM])
        elif material >= 0:
            number = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
            repeat = model.mat_texrepeat[material].tolist()
            is_uniform = bool(model.mat_texuniform[material])
        if number < 0 or material < 0 or row[_TYPE] in (GEOM.mjGEOM_LINE, GEOM.mjGEOM_LINEBOX):
            return None, None
        if model.tex_type[number] != mujoco.mjtTexture.mjTEXTURE_2D:
            factors = tuple(size) if is_uniform else (1.0, 1.0, 1.0)
            return self._get_texture(number, (1.0, 1.0), (0.0, 0.0)), ("cube", factors)
        sides = [side if is_uniform and side > 0.0 else 1.0 for side in size[:2]]
        is_flat = row[_TYPE] == GEOM.mjGEOM_HFIELD or (
            row[_TYPE] in (GEOM.mjGEOM_MESH, GEOM.mjGEOM_SDF, GEOM.mjGEOM_SKIN) and not row[_HAS_UV]
        )
        if is_flat:
            own = [side if side > 0.0 else 1.0 for side in size[:2]]
            scale = repeat[0] / own[0] * sides[0], repeat[1] / own[1] * sides[1]
            return self._get_texture(number, scale, (-0.5, 0.5)), ("flat", None)
        repeat = [part if part > 0.0 else 1.0 for part in repeat]
        scale = repeat[0] * sides[0], repeat[1] * sides[1]
        is_infinite = row[_TYPE] == GEOM.mjGEOM_PLANE and min(size[:2]) <= 0.0
        move = (-0.5, 1.5 - scale[1]) if is_infinite else (0.0, 1.0 - scale[1])
        return self._get_texture(number, scale, move), ("uv", None)

    def _get_texture(
        self, number: int, scale: tuple[float, float], offset: tuple[float, float]
    ) -> Texture:
        """Return a texture of the model with a scale and an offset of its coordinates."""
        key = number, scale, offset
        if not mark_used(self._textures, key):
            whole = self._whole_textures.get(number)
            if whole is None:
                whole = self._whole_textures[number] = Texture(
                    get_texture_picture(self._model, number),
                    color_space="linear" if self._as_codes else "srgb",
                )
            self._textures[key] = whole.with_transform(offset=offset, scale=scale)
        return self._textures[key]

    def _make_material(
        self, rgba: Sequence[float], row: tuple[Any, ...], texture: Texture | None, is_behind: bool
    ) -> Material:
        """Return the material of a geom."""
        *color, alpha = np.clip(rgba, 0.0, 1.0).tolist()
        color = self._to_light(color).tolist()
        if is_behind:
            alpha *= BACK_ALPHA_FACTOR
        is_blended = alpha < MIN_OPAQUE_ALPHA or is_behind
        mode: AlphaMode = "blend" if is_blended else "opaque"
        # MuJoCo draws transparent geoms twice.
        alpha = 1.0 - (1.0 - alpha) ** 2 if is_blended else 1.0
        if row[_TYPE] in (GEOM.mjGEOM_LINE, GEOM.mjGEOM_LINEBOX):
            return Material("unlit", (*color, alpha), alpha_mode=mode)
        # In MuJoCo the texture multiplies the highlight, here it does not: use its mean.
        specular = self._specular_gain * row[_SPECULAR]
        if texture is not None:
            specular *= float(texture.image[..., :3].mean())
        return Material(
            "phong", (*color, alpha), specular=specular,
            shininess=max(128.0 * row[_SHININESS], 1e-3), base_color_texture=texture,
            emissive=[row[_EMISSION] * part for part in color],
            emissive_texture=texture if row[_EMISSION] > 0.0 else None,
            alpha_mode=mode,
            double_sided=row[_TYPE] in (GEOM.mjGEOM_PLANE, GEOM.mjGEOM_TRIANGLE)
            or not self._is_culled,
            casts_shadow=row[_CATEGORY] != mujoco.mjtCatBit.mjCAT_DECOR,
        )  # fmt: skip

    @property
    def _is_culled(self) -> bool:
        """Whether back faces are culled."""
        return bool(self._geom_scene.flags[FLAG.mjRND_CULL_FACE])

    # Light.

    def _to_light(self, color: Any) -> Float64:
        """Return a colour of MuJoCo's as light: decoded, unless light is computed with codes."""
        codes = np.asarray(color, np.float64)
        if self._as_codes:
            return codes
        return np.interp(codes, np.arange(256) / 255.0, decoding_table())

    def _update_lights(self, scene: Any) -> None:
        """Set the lights of the scene to MuJoCo's, if they have changed."""
        lights = [
            light
            for light in scene.lights[: scene.nlight]
            # Before mj_forward, directions are zero.
            if light.type != LIGHT.mjLIGHT_IMAGE and light.dir.any()
        ]
        values = [[*map(_to_list, _LIGHT_FIELDS(light))] for light in lights]
        has_shadows = bool(scene.flags[FLAG.mjRND_SHADOW] and self._model.vis.quality.shadowsize)
        if (values, has_shadows) == self._light_values:
            return
        self._light_values = values, has_shadows
        ambient = sum((np.array(light.ambient, np.float64) for light in lights), np.zeros(3))
        if not lights:
            ambient = np.full(3, 0.3)
        self.lights[:] = [
            AmbientLight(self._to_light(np.minimum(ambient, 1.0)), 1.0),
            *(self._convert_light(light, has_shadows) for light in lights),
        ]
        diffuse = sum(float(np.sum(light.diffuse)) for light in lights)
        specular = sum(float(np.sum(light.specular)) for light in lights)
        self._specular_gain = specular / diffuse if diffuse > 0.0 else 0.0

    def _convert_light(self, light: Any, has_shadows: bool) -> Light:
        """Convert a light of MuJoCo's."""
        color = np.clip(np.asarray(light.diffuse, np.float64), 0.0, None)
        strength = max(1.0, *color.tolist())
        color = self._to_light(color / strength)
        shadow = None
        if has_shadows and light.castshadow:
            size = min(self._shadow_size, max(16, int(self._model.vis.quality.shadowsize)))
            shadow = Shadow(size=size)
        if light.type == LIGHT.mjLIGHT_DIRECTIONAL:
            return DirectionalLight(light.dir, color, strength, shadow)
        # Our lights fall off with the squared distance: match MuJoCo's at the model's centre.
        distance = float(np.linalg.norm(light.pos - self._model.stat.center))
        constant, linear, squared = light.attenuation.tolist()
        attenuation = constant + linear * distance + squared * distance * distance
        strength *= max(distance * distance, 1e-6) / max(attenuation, 1e-6)
        if light.type == LIGHT.mjLIGHT_POINT or light.cutoff > 90.0:
            return PointLight(light.pos, color, strength, shadow=shadow)
        outer, inner = float(light.cutoff), float(light.cutoff)
        if light.exponent > 0.0:
            # The cone whose ramp is at half its light where MuJoCo's power of the cosine is.
            cosine = (0.5 ** (1.0 / light.exponent) - HALF_LIGHT_RAMP) / (1.0 - HALF_LIGHT_RAMP)
            outer = min(outer, float(np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))))
            inner = 0.0
        return SpotLight(
            light.pos, light.dir, color, strength, inner, max(outer, 1e-3), shadow=shadow
        )

    # What is not drawn.

    def _warn_unsupported(self, rows: list[tuple[Any, ...]]) -> None:
        """Warn once of each feature that is not drawn."""
        scene = self._geom_scene
        missing = [name for flag, name in UNSUPPORTED_FLAGS if scene.flags[flag]]
        kinds = {int(row[_TYPE]) for row in rows} - PARTS_BY_KIND.keys()
        missing.extend(f"geoms of the unknown type {kind}" for kind in sorted(kinds))
        if any(light.type == LIGHT.mjLIGHT_IMAGE for light in scene.lights[: scene.nlight]):
            missing.append("lights of type image")
        if not self._as_codes and self.find_mirror() is not None:
            missing.append("reflections")
        flexes = [row[_NUMBER] for row in rows if row[_TYPE] == GEOM.mjGEOM_FLEX]
        if (scene.flexvertopt or scene.flexedgeopt) and any(
            not (scene.flexskinopt and scene.flexfaceused[number]) for number in flexes
        ):
            missing.append("vertices and edges of flexes")
        if any(geom.label for geom in scene.geoms[: scene.ngeom]):
            missing.append("labels")
        for is_set, name in (
            (scene.enabletransform, "transforms of the whole scene"), (scene.stereo, "stereo"),
            (scene.framewidth, "frames around pictures"),
        ):  # fmt: skip
            if is_set:
                missing.append(name)
        new = [name for name in missing if name not in self._warned]
        if new:
            self._warned.update(new)
            warn_caller(f"not drawn: {', '.join(new)}")


def mark_used(cache: dict[Any, Any], key: Any) -> bool:
    """Move the item of a key to the end of a cache; tell whether there is one."""
    if key not in cache:
        return False
    cache[key] = cache.pop(key)
    return True


def drop_oldest(cache: dict[Any, Any], max_items: int) -> None:
    """Drop the least recently used items above ``max_items``."""
    for key in [*cache][: max(0, len(cache) - max_items)]:
        del cache[key]


def check_state(name: str, data: Any, model: Any) -> None:
    """Raise ``ValueError`` unless ``data`` is a state of a model, or of one of the same sizes."""
    if not isinstance(data, mujoco.MjData):
        raise ValueError(f"{name} must be a mujoco.MjData, got {brief(data)}")
    # Environments each load a model of their own from the same file.
    if data.signature == model.signature:
        return
    other = data.model
    for size in STATE_SIZES:
        expected, found = getattr(model, size), getattr(other, size)
        if expected != found:
            raise ValueError(
                f"{name} must be of the renderer's model, with {size} = {expected}, got that of "
                f"another with {size} = {found}"
            )


def _to_list(value: Any) -> Any:
    """Return an array as a list, and all else as it is."""
    return value.tolist() if isinstance(value, np.ndarray) else value


def find_camera(model: Any, camera: Any) -> Any:
    """Return a camera by its number or name, or raise ``ValueError``."""
    if isinstance(camera, mujoco.MjvCamera):
        return camera
    number = camera
    if isinstance(camera, str):
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA.value, camera)
        if number < 0:
            names = [model.camera(n).name for n in range(model.ncam)]
            raise ValueError(f"camera must be one of {names}, got {camera!r}")
    if isinstance(number, bool) or not isinstance(number, int | np.integer):
        raise ValueError(f"camera must be a number, a name or an MjvCamera, got {camera!r}")
    if not -1 <= number < model.ncam:
        raise ValueError(f"camera must be in -1..{model.ncam - 1}, got {camera!r}")
    found = mujoco.MjvCamera()
    if number < 0:
        mujoco.mjv_defaultFreeCamera(model, found)
    else:
        found.type, found.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, int(number)
    return found


def get_texture_picture(model: Any, number: int) -> NDArray[np.uint8]:
    """Return the texels of a texture, (H, W, 3); of a cube its six sides below each other."""
    width, height = int(model.tex_width[number]), int(model.tex_height[number])
    channels, first = int(model.tex_nchannel[number]), int(model.tex_adr[number])
    texels = model.tex_data[first : first + width * height * channels]
    picture = texels.reshape(height, width, channels)[..., :3]
    is_cube = model.tex_type[number] != mujoco.mjtTexture.mjTEXTURE_2D
    return np.tile(picture, (6, 1, 1)) if is_cube and width == height else picture


def _make_lines(part: str, width: float, material: Material) -> Lines:
    """Return a line along z from 0 to 1, or the edges of a box of size 1."""
    if part == "line":
        points, segments = np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]), np.array([[0, 1]])
    else:
        points = np.array([[(n >> axis & 1) * 2.0 - 1.0 for axis in range(3)] for n in range(8)])
        segments = np.array([(n, n | 1 << k) for n in range(8) for k in range(3) if not n >> k & 1])
    return Lines(points, segments, width=width, caps="butt", material=material)
