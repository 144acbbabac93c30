"""
Convert cameras of OpenCV, OpenGL, PyTorch3D, Blender and trimesh to ours and back.

Each pair of functions keeps to one convention: where the axes of the camera point, whether vectors
are columns or rows, and where on the first pixel the origin of pixel coordinates is. World axes are
never changed: a scene whose z is up stays one. A camera that is made for an image of one size
refuses images of another aspect, which it would have to stretch; see `rasterjit.MatrixCamera`. No
pose may mirror: all functions refuse one of a determinant below 0. `rasterjit.load_cameras` reads
files, with lenses.

=============  ====================  =======  ====================  =============================
convention     x, y, z point         vectors  pose                  pixel coordinates
=============  ====================  =======  ====================  =============================
ours, OpenGL   right, up, back       columns  view from world       first corner at (0, 0)
OpenCV         right, down, forward  columns  camera from world     centre of the first at (0, 0)
PyTorch3D      left, up, forward     rows     camera from world     first corner at (0, 0)
Blender        right, up, back       columns  world from camera     by lens, sensor and shift
trimesh        right, up, back       columns  world from camera     principal point in the middle
=============  ====================  =======  ====================  =============================

References
----------
.. [1] OpenCV documentation, "Camera Calibration and 3D Reconstruction".
.. [2] The Khronos Group, "OpenGL 4.6 Core Profile", section 13.8, "Coordinate Transformations".
.. [3] PyTorch3D documentation, "Cameras".
.. [4] Blender Python API, ``bpy.types.Camera``; Blender Manual, "Cameras".
.. [5] trimesh documentation, ``trimesh.scene.cameras``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import transforms
from rasterjit.scene.camera import (
    Camera,
    MatrixCamera,
    PerspectiveCamera,
    check_camera,
    default_near,
)
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.validation import (
    brief,
    check_rotation,
    finite_array,
    finite_number,
    image_size,
    is_infinite,
    one_of,
    positive_number,
    unmasked_array,
)

if TYPE_CHECKING:
    import trimesh

Float64 = NDArray[np.float64]

ScreenSpace: TypeAlias = Literal["ndc", "screen"]
SCREEN_SPACES: tuple[ScreenSpace, ...] = get_args(ScreenSpace)
"""Units of PyTorch3D's focal length and principal point: half sides of the picture; pixels."""

BlenderType: TypeAlias = Literal["PERSP", "ORTHO"]
BLENDER_TYPES: tuple[BlenderType, ...] = get_args(BlenderType)

SensorFit: TypeAlias = Literal["AUTO", "HORIZONTAL", "VERTICAL"]
SENSOR_FITS: tuple[SensorFit, ...] = get_args(SensorFit)
"""Which side of the picture Blender's sensor fits: the longer one; the width; the height."""

_RELATIVE_TOLERANCE = 1e-6
"""Relative difference of two focal lengths, or of pixels of a principal point, up to which
they count as equal: float32 matrices keep seven digits."""

_AXIS_SIGNS = {"opencv": (1.0, -1.0, -1.0), "pytorch3d": (-1.0, 1.0, -1.0)}
"""Signs of our view axes in another camera's."""


class OpenCVCamera(NamedTuple):
    """
    A camera as OpenCV has it.

    ``pixel = K (R world + t)``, divided by its last component.
    """

    intrinsics: Float64
    """(3, 3): K, pixels; the centre of the first pixel is at (0, 0)."""
    rotation: Float64
    """(3, 3): R."""
    translation: Float64
    """(3,): t, scene units."""

    @property
    def camera_from_world(self) -> Matrix:
        """(4, 4): R and t in one matrix."""
        return _make_affine(self.rotation, self.translation)


class OpenGLCamera(NamedTuple):
    """OpenGL's view and projection for column vectors; OpenGL takes them column by column."""

    view: Matrix
    """(4, 4): eye coordinates from world."""
    projection: Matrix
    """(4, 4): clip coordinates from eye; -1 is the near plane."""


class PyTorch3DCamera(NamedTuple):
    """
    The arguments of PyTorch3D's ``PerspectiveCameras``, without their batch axis.

    ``camera = world R + T``, of row vectors.
    """

    R: Float64
    """(3, 3)."""
    T: Float64
    """(3,), scene units."""
    focal_length: Float64
    """(2,): of x and y, in NDC or in pixels."""
    principal_point: Float64
    """(2,): in NDC (x left, y up) or in pixels (x right, y down)."""


class BlenderCamera(NamedTuple):
    """The properties of a camera object of Blender, under Blender's names."""

    matrix_world: Matrix
    """(4, 4): of the object."""
    type: BlenderType
    """``"PERSP"`` or ``"ORTHO"``."""
    lens: float
    """Focal length, millimetres."""
    sensor_width: float
    """Millimetres."""
    sensor_fit: SensorFit
    """``"HORIZONTAL"``: the sensor's width is the image's."""
    shift_x: float
    shift_y: float
    """Shares of the image's width."""
    ortho_scale: float
    """Width of what is shown, scene units."""
    clip_start: float
    clip_end: float
    """Scene units; infinite where there is no far plane, which Blender does not know."""


class TrimeshCamera(NamedTuple):
    """A camera of trimesh and its pose: ``scene.camera`` and ``scene.camera_transform``."""

    camera: trimesh.scene.Camera
    transform: Matrix
    """(4, 4): world from camera."""


class _Pinhole(NamedTuple):
    """Focal lengths, skew and principal point in pixels, y down, first corner at (0, 0)."""

    fx: float
    fy: float
    skew: float
    cx: float
    cy: float
    near: float | None
    far: float


def view_from_pose(pose: ArrayLike, name: str = "pose") -> Matrix:
    """
    Return ``view_from_world`` of a camera, given its pose.

    Parameters
    ----------
    pose : (4, 4) array_like
        World from camera, which looks along its -z with y up; its scale does not count.
    name : str
        What the message calls the pose.

    Raises
    ------
    ValueError
        If it is not affine, or mirrors or shears.
    """
    matrix = finite_array(name, pose, (4, 4))
    if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ValueError(f"{name} must have last row (0, 0, 0, 1), got {matrix[3].tolist()}")
    axes = np.stack([transforms.unit_vector(name, matrix[:3, k]) for k in range(3)], axis=1)
    check_rotation(name, axes)
    return _invert_affine(_make_affine(axes, matrix[:3, 3]))


def intrinsic_matrix(name: str, value: ArrayLike) -> Float64:
    """Return K as float64, (3, 3), or raise ``ValueError`` naming the argument."""
    k = finite_array(name, value, (3, 3))
    if k[1, 0] != 0.0 or k[2].tolist() != [0.0, 0.0, 1.0]:
        raise ValueError(f"{name} must be upper triangular, last entry 1, got {k.tolist()}")
    if k[0, 0] <= 0.0 or k[1, 1] <= 0.0:
        raise ValueError(f"{name} must have focal lengths above 0, got {k.tolist()}")
    return k


def from_opencv(
    intrinsics: ArrayLike,
    size: tuple[int, int],
    *,
    rotation: ArrayLike | None = None,
    translation: ArrayLike | None = None,
    camera_from_world: ArrayLike | None = None,
    near: float | None = None,
    far: float = math.inf,
) -> MatrixCamera:
    """
    Return the camera of OpenCV's K, R and t.

    Parameters
    ----------
    intrinsics : (3, 3) array_like
        K, pixels: focal lengths, skew and principal point, which may be anywhere. The centre of
        the first pixel is at (0, 0). Distortion is drawn by ``render(..., lens=)``:
        ``PinholeDistortion(*dist.ravel())`` or ``FisheyeLens(*D.ravel())``.
    size : (int, int)
        Width and height of the image that K is for, pixels.
    rotation, translation : (3, 3) and (3,) or (3, 1) array_like, optional
        R and t; ``cv2.Rodrigues`` makes R of a rotation vector. Default: the identity and 0.
    camera_from_world : (4, 4) or (3, 4) array_like, optional
        In place of the two: the extrinsic matrix.
    near : float, optional, scene units
        Distance of the near plane. Default: chosen as `PerspectiveCamera` says.
    far : float, scene units
        Distance of the far plane; may be ``math.inf``.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    k = intrinsic_matrix("intrinsics", intrinsics)
    if camera_from_world is not None:
        if rotation is not None or translation is not None:
            raise ValueError("camera_from_world must be None where rotation or translation is not")
        pose = _check_extrinsic("camera_from_world", camera_from_world)
    else:
        pose = _make_rigid_pose(
            ("rotation", np.eye(3) if rotation is None else rotation),
            ("translation", np.zeros(3) if translation is None else translation),
        )
    pinhole = _Pinhole(k[0, 0], k[1, 1], k[0, 1], k[0, 2] + 0.5, k[1, 2] + 0.5, near, far)
    return _make_camera(pinhole, size, transforms.compose(_make_axis_flip("opencv"), pose))


def to_opencv(camera: Camera, size: tuple[int, int]) -> OpenCVCamera:
    """
    Return a perspective camera as OpenCV's K, R and t.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height of the image, pixels.

    Raises
    ------
    ValueError
        If the camera is no pinhole (a parallel or an oblique projection), or its view scales.
    """
    pinhole = _get_pinhole(camera, size)
    pose = transforms.compose(_make_axis_flip("opencv"), _get_rigid_view(camera))
    k = [[pinhole.fx, pinhole.skew, pinhole.cx - 0.5], [0.0, pinhole.fy, pinhole.cy - 0.5]]
    return OpenCVCamera(np.array([*k, [0.0, 0.0, 1.0]]), pose[:3, :3].copy(), pose[:3, 3].copy())


def from_opengl(view: ArrayLike, projection: ArrayLike) -> MatrixCamera:
    """
    Return the camera of OpenGL's matrices.

    Parameters
    ----------
    view, projection : (4, 4) array_like
        For column vectors. What OpenGL or GLM hand out column by column has to be transposed.

    Raises
    ------
    ValueError
        As `MatrixCamera` does, naming ``view`` or ``projection``.
    """
    eye = finite_array("view", view, (4, 4))
    clip = finite_array("projection", projection, (4, 4))
    if eye[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ValueError(
            f"view must have last row (0, 0, 0, 1), got {eye[3].tolist()}; transpose what is "
            "stored column by column"
        )
    try:
        return MatrixCamera(eye, clip)
    except ValueError as error:
        message = str(error).replace("view_from_world", "view")
        raise ValueError(message.replace("clip_from_view", "projection")) from None


def to_opengl(camera: Camera, size: tuple[int, int]) -> OpenGLCamera:
    """
    Return a camera as OpenGL's matrices.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height of the image, pixels.

    Raises
    ------
    ValueError
        If the size is wrong, or the camera is none.
    """
    check_camera("camera", camera)
    return OpenGLCamera(camera.view_matrix(), camera.projection_matrix(image_size("size", size)))


def from_pytorch3d(
    R: ArrayLike,
    T: ArrayLike,
    focal_length: float | ArrayLike,
    size: tuple[int, int],
    *,
    principal_point: ArrayLike | None = None,
    space: ScreenSpace = "ndc",
    near: float | None = None,
    far: float = math.inf,
) -> MatrixCamera:
    """
    Return the camera of PyTorch3D's ``PerspectiveCameras``.

    Parameters
    ----------
    R, T : (3, 3) and (3,) array_like
        Of row vectors: ``camera = world R + T``. A leading axis of length 1 may be there.
    focal_length : float or (2,) array_like
        Of x and y, or of both. That of ``FoVPerspectiveCameras`` with a field of view f across the
        shorter side is 1/tan(f/2).
    size : (int, int)
        Width and height of the image, pixels; PyTorch3D's ``image_size`` is (height, width).
    principal_point : (2,) array_like, optional
        Default: the middle of the image.
    space : {"ndc", "screen"}
        What focal length and principal point are in: NDC, where the image's shorter side is 2 long,
        x points left and y up, or pixels from the upper left corner (``in_ndc=False``).
    near : float, optional, scene units
        Distance of the near plane. Default: chosen as `PerspectiveCamera` says.
    far : float, scene units
        Distance of the far plane; may be ``math.inf``.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    width, height = image_size("size", size)
    one_of("space", space, SCREEN_SPACES)
    rotation, shift = _drop_batch_axis("R", R, 2), _drop_batch_axis("T", T, 1)
    matrix = finite_array("R", rotation, (3, 3))
    focal = np.ravel(_drop_batch_axis("focal_length", focal_length, 1))
    fx, fy = finite_array("focal_length", np.repeat(focal, 2) if len(focal) == 1 else focal, (2,))
    if fx <= 0.0 or fy <= 0.0:
        raise ValueError(f"focal_length must be above 0, got {focal.tolist()}")
    unit = min(width, height) / 2.0 if space == "ndc" else 1.0
    cx, cy = width / 2.0, height / 2.0
    if principal_point is not None:
        x, y = finite_array(
            "principal_point", _drop_batch_axis("principal_point", principal_point, 1), (2,)
        )
        cx, cy = (cx - x * unit, cy - y * unit) if space == "ndc" else (x, y)
    pose = _make_rigid_pose(("R", matrix.T), ("T", shift))
    pinhole = _Pinhole(fx * unit, fy * unit, 0.0, cx, cy, near, far)
    return _make_camera(pinhole, size, transforms.compose(_make_axis_flip("pytorch3d"), pose))


def to_pytorch3d(
    camera: Camera, size: tuple[int, int], space: ScreenSpace = "ndc"
) -> PyTorch3DCamera:
    """
    Return a perspective camera as PyTorch3D's ``PerspectiveCameras`` takes it.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height of the image, pixels.
    space : {"ndc", "screen"}
        What focal length and principal point are in; see `from_pytorch3d`.

    Raises
    ------
    ValueError
        If the camera is no pinhole without skew, or its view scales.
    """
    width, height = image_size("size", size)
    one_of("space", space, SCREEN_SPACES)
    pinhole = _check_no_skew(_get_pinhole(camera, size))
    pose = transforms.compose(_make_axis_flip("pytorch3d"), _get_rigid_view(camera))
    focal, point = np.array([pinhole.fx, pinhole.fy]), np.array([pinhole.cx, pinhole.cy])
    if space == "ndc":
        unit = min(width, height) / 2.0
        focal, point = focal / unit, (np.array([width, height]) / 2.0 - point) / unit
    return PyTorch3DCamera(pose[:3, :3].T.copy(), pose[:3, 3].copy(), focal, point)


def from_blender(
    matrix_world: ArrayLike,
    size: tuple[int, int],
    *,
    type: BlenderType = "PERSP",
    lens: float | None = None,
    fov: float | None = None,
    sensor_width: float = 36.0,
    sensor_height: float = 24.0,
    sensor_fit: SensorFit = "AUTO",
    shift_x: float = 0.0,
    shift_y: float = 0.0,
    ortho_scale: float = 6.0,
    clip_start: float = 0.1,
    clip_end: float = math.inf,
) -> MatrixCamera:
    """
    Return the camera of a Blender scene; arguments have Blender's names and defaults.

    Blender's world has z up; it stays as it is, as the meshes do.

    Parameters
    ----------
    matrix_world : (4, 4) array_like
        Of the camera's object; its scale does not count, as in Blender.
    size : (int, int)
        Width and height of the image, pixels, which are square.
    type : {"PERSP", "ORTHO"}
    lens : float, optional
        Focal length, millimetres; default 50.
    fov : float, degrees, optional
        In place of ``lens``: the field of view along the side that the sensor fits
        (``camera.angle``, there in radians).
    sensor_width, sensor_height : float
        Millimetres.
    sensor_fit : {"AUTO", "HORIZONTAL", "VERTICAL"}
        Which side of the image the sensor fits: its width the longer side, its width the width, or
        its height the height.
    shift_x, shift_y : float
        Shares of that side by which the view is moved right and up.
    ortho_scale : float, scene units
        How much of the scene lies along that side of a parallel view.
    clip_start, clip_end : float, scene units
        Distances of the near and far plane; a parallel view needs a far plane.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    width, height = image_size("size", size)
    one_of("type", type, BLENDER_TYPES)
    one_of("sensor_fit", sensor_fit, SENSOR_FITS)
    view = view_from_pose(matrix_world, "matrix_world")
    fits_width = sensor_fit == "HORIZONTAL" or (sensor_fit == "AUTO" and width >= height)
    side = float(width if fits_width else height)
    right, up = finite_number("shift_x", shift_x), finite_number("shift_y", shift_y)
    if type == "ORTHO":
        if is_infinite(clip_end):
            raise ValueError("clip_end must be finite for type 'ORTHO', got inf")
        start, end = finite_number("clip_start", clip_start), finite_number("clip_end", clip_end)
        if end <= start:
            raise ValueError(f"clip_end must be above clip_start = {start!r}, got {end!r}")
        pixel = positive_number("ortho_scale", ortho_scale) / side
        x, y = (width * pixel / 2.0, height * pixel / 2.0)
        right, up = right * side * pixel, up * side * pixel
        clip = transforms.orthographic(right - x, right + x, up - y, up + y, clip_start, clip_end)
        return MatrixCamera(view, clip, (width, height))
    _check_near_far(("clip_start", "clip_end"), clip_start, clip_end)
    if sensor_fit == "VERTICAL":
        sensor = positive_number("sensor_height", sensor_height)
    else:
        sensor = positive_number("sensor_width", sensor_width)
    if fov is not None:
        if lens is not None:
            raise ValueError(f"lens must be None where fov is given, got {lens!r}")
        focal = transforms.focal_length(fov) * side / 2.0
    else:
        focal = positive_number("lens", 50.0 if lens is None else lens) * side / sensor
    cx, cy = width / 2.0 - right * side, height / 2.0 + up * side
    pinhole = _Pinhole(focal, focal, 0.0, cx, cy, clip_start, clip_end)
    return _make_camera(pinhole, size, view)


def to_blender(camera: Camera, size: tuple[int, int], sensor_width: float = 36.0) -> BlenderCamera:
    """
    Return a camera as Blender describes it.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height of the image, pixels: Blender's render resolution.
    sensor_width : float
        Millimetres; the lens is chosen for it.

    Raises
    ------
    ValueError
        If the camera's pixels are not square, it has skew, or its view scales.
    """
    width, height = image_size("size", size)
    sensor = positive_number("sensor_width", sensor_width)
    view = _get_rigid_view(camera)
    clip = camera.projection_matrix((width, height))
    pose = _invert_affine(view)
    if not clip[3, :3].any():
        x, y, near, far = _get_orthographic_parameters(clip)
        extent = 2.0 / x[0]
        _check_square_pixels("the scale of x and y", extent / width, 2.0 / y[0] / height)
        shifts = -x[1] / 2.0, -y[1] / y[0] / extent
        return BlenderCamera(pose, "ORTHO", 50.0, sensor, "HORIZONTAL", *shifts, extent, near, far)
    pinhole = _check_no_skew(_get_pinhole(camera, size))
    _check_square_pixels("the focal lengths", pinhole.fx, pinhole.fy)
    shifts = (width / 2.0 - pinhole.cx) / width, (pinhole.cy - height / 2.0) / width
    lens = pinhole.fx * sensor / width
    return BlenderCamera(
        pose,
        "PERSP",
        lens,
        sensor,
        "HORIZONTAL",
        *shifts,
        6.0,
        default_near(pinhole.near, pinhole.far),
        pinhole.far,
    )


_TRIMESH_FAR = 1000.0
"""The far distance of a trimesh camera that nobody set; taken as no far plane at all."""


def from_trimesh(camera: trimesh.scene.Camera, transform: ArrayLike) -> MatrixCamera:
    """
    Return the camera of a trimesh scene; render it in its own resolution.

    There it shows what the camera of the scene does that `rasterjit.load` makes, which takes other
    sizes, too, as it keeps the vertical field of view and the shape of pixels. A far plane at
    1000, which trimesh gives a camera that was told none, is none.

    Parameters
    ----------
    camera : trimesh.scene.Camera
        Its ``resolution`` is (width, height).
    transform : (4, 4) array_like
        ``scene.camera_transform``: world from camera.

    Raises
    ------
    ValueError
        Naming the argument that is wrong.
    """
    pinhole, size = _read_trimesh_camera(camera)
    return _make_camera(pinhole, size, view_from_pose(transform, "transform"))


def perspective_from_trimesh(camera: trimesh.scene.Camera, pose: Matrix) -> PerspectiveCamera:
    """Return the camera of a trimesh scene for images of any size, or raise ``ValueError``."""
    pinhole, _ = _read_trimesh_camera(camera)
    pose = finite_array("pose", pose, (4, 4))
    eye, shape = pose[:3, 3], pinhole.fy / pinhole.fx
    return PerspectiveCamera(
        eye, eye - pose[:3, 2], pose[:3, 1], fov_y=float(camera.fov[1]), near=pinhole.near,
        far=pinhole.far, pixel_aspect=1.0 if abs(shape - 1.0) <= _RELATIVE_TOLERANCE else shape,
    )  # fmt: skip


def _read_trimesh_camera(camera: Any) -> tuple[_Pinhole, tuple[int, int]]:
    """Return a camera of trimesh as a pinhole, and its resolution, or raise ``ValueError``."""
    try:
        fx, fy = (float(length) for length in camera.focal)
        size = image_size("camera.resolution", tuple(camera.resolution.tolist()))
        near, far = float(camera.z_near), float(camera.z_far)
    except (AttributeError, TypeError):
        raise ValueError(f"camera must be a trimesh.scene.Camera, got {brief(camera)}") from None
    for length in (fx, fy):
        positive_number("camera.focal", length)
    far = math.inf if far == _TRIMESH_FAR else far
    _check_near_far(("camera.z_near", "camera.z_far"), near, far)
    pinhole = _Pinhole(fx, fy, 0.0, size[0] / 2.0, size[1] / 2.0, near, far)
    return pinhole, size


def to_trimesh(camera: Camera, size: tuple[int, int]) -> TrimeshCamera:
    """
    Return a perspective camera as trimesh has it.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height of the image, pixels.

    Raises
    ------
    ValueError
        If its principal point is not the middle of the image, it is no pinhole without skew, or its
        view scales.
    """
    from trimesh.scene import Camera as SceneCamera

    width, height = image_size("size", size)
    pinhole = _check_no_skew(_get_pinhole(camera, size))
    for axis, value, middle in (("x", pinhole.cx, width / 2.0), ("y", pinhole.cy, height / 2.0)):
        if abs(value - middle) > _RELATIVE_TOLERANCE * middle:
            raise ValueError(
                "camera must have its principal point in the middle of the image for trimesh, got "
                f"{axis} = {value!r} of {2.0 * middle:g}"
            )
    trimesh_camera = SceneCamera(
        resolution=(width, height), focal=(pinhole.fx, pinhole.fy), z_near=pinhole.near,
        z_far=pinhole.far,
    )  # fmt: skip
    return TrimeshCamera(trimesh_camera, _invert_affine(_get_rigid_view(camera)))


def _check_near_far(names: tuple[str, str], near: float, far: float) -> None:
    """Raise ``ValueError`` if a far plane is not sufficiently beyond the near plane."""
    start = positive_number(names[0], near)
    end = math.inf if is_infinite(far) else finite_number(names[1], far)
    if start < transforms.MIN_NEAR * end < math.inf:
        least = transforms.rounded_up(transforms.MIN_NEAR * end)
        raise ValueError(
            f"{names[0]} must be at least {least}, or {names[1]} math.inf, got {start!r}, {end!r}"
        )
    if end <= start:
        raise ValueError(f"{names[1]} must be above {names[0]} = {start!r}, got {end!r}")


def _make_camera(pinhole: _Pinhole, size: tuple[int, int], view: Matrix) -> MatrixCamera:
    """Return the camera of a pinhole, for an image of (width, height) pixels."""
    width, height = image_size("size", size)
    fx, fy = (positive_number("focal length", one) for one in (pinhole.fx, pinhole.fy))
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1] = 2.0 * fx / width, 2.0 * fy / height
    # The other's y points down: the skew turns its sign.
    clip[0, 1] = -2.0 * pinhole.skew / width
    clip[0, 2], clip[1, 2] = 1.0 - 2.0 * pinhole.cx / width, 2.0 * pinhole.cy / height - 1.0
    near = default_near(pinhole.near, pinhole.far)
    clip[2, 2:] = transforms.perspective_depth(near, pinhole.far)
    clip[3, 2] = -1.0
    return MatrixCamera(view, clip + 0.0, (width, height), pinhole.near is None)


def _get_pinhole(camera: Camera, size: tuple[int, int]) -> _Pinhole:
    """Return a perspective camera as a pinhole, or raise ``ValueError``."""
    check_camera("camera", camera)
    width, height = image_size("size", size)
    clip = camera.projection_matrix((width, height))
    if clip[3, 2] >= 0.0 or clip[3, [0, 1, 3]].any() or clip[:2, 3].any() or clip[1, 0] != 0.0:
        raise ValueError(
            f"camera must be a perspective along its own z axis, got the projection {clip.tolist()}"
        )
    clip = clip / -clip[3, 2]
    slope, offset = clip[2, 2:].tolist()
    near = offset / (slope - 1.0)
    far = math.inf if slope == -1.0 else offset / (slope + 1.0)
    return _Pinhole(
        clip[0, 0] * width / 2.0,
        clip[1, 1] * height / 2.0,
        -clip[0, 1] * width / 2.0 + 0.0,
        (1.0 - clip[0, 2]) * width / 2.0,
        (1.0 + clip[1, 2]) * height / 2.0,
        near,
        far,
    )


def _get_orthographic_parameters(
    clip: Matrix,
) -> tuple[tuple[float, float], tuple[float, float], float, float]:
    """Return scale and offset of x and of y, near and far of a parallel view, or raise."""
    clip = clip / clip[3, 3]
    if clip[0, [1, 2]].any() or clip[1, [0, 2]].any() or clip[2, :2].any():
        raise ValueError(f"camera must look along its own z axis, got {clip.tolist()}")
    scale, middle = clip[2, 2:].tolist()
    near, far = (middle + 1.0) / scale, (middle - 1.0) / scale
    return (clip[0, 0], clip[0, 3]), (clip[1, 1], clip[1, 3]), near, far


def _get_rigid_view(camera: Camera) -> Matrix:
    """Return a camera's view if it only turns and moves, or raise ``ValueError``."""
    check_camera("camera", camera)
    view = camera.view_matrix()
    check_rotation("camera", view[:3, :3])
    return view


def _check_extrinsic(name: str, value: ArrayLike) -> Matrix:
    """Return a (3, 4) or (4, 4) pose as (4, 4), or raise ``ValueError``."""
    array = unmasked_array(name, value)
    rows = finite_array(name, array, (3, 4) if array.shape == (3, 4) else (4, 4))
    if len(rows) == 4 and rows[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ValueError(f"{name} must have last row (0, 0, 0, 1), got {rows[3].tolist()}")
    check_rotation(name, rows[:3, :3])
    return _make_affine(rows[:3, :3], rows[:3, 3])


def _make_rigid_pose(rotation: tuple[str, ArrayLike], translation: tuple[str, ArrayLike]) -> Matrix:
    """Return a pose from a rotation and a translation, each with its name."""
    matrix = finite_array(*rotation, (3, 3))
    check_rotation(rotation[0], matrix)
    shift = unmasked_array(translation[0], translation[1])
    shift = shift[:, 0] if shift.shape == (3, 1) else shift
    return _make_affine(matrix, finite_array(translation[0], shift, (3,)))


def _invert_affine(pose: Matrix) -> Matrix:
    """Return the inverse of an affine matrix."""
    inverse = _make_affine(transforms.normal_matrix(pose).T, np.zeros(3))
    return transforms.compose(inverse, transforms.translate(-pose[:3, 3])) + 0.0


def _make_affine(linear: Float64, shift: Float64) -> Matrix:
    """Return the (4, 4) matrix of a linear part and a translation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift
    return matrix


def _make_axis_flip(convention: str) -> Matrix:
    """Return the matrix between our view axes and another camera's, its own inverse."""
    return np.diag([*_AXIS_SIGNS[convention], 1.0])


def _check_no_skew(pinhole: _Pinhole) -> _Pinhole:
    """Return a pinhole, or raise ``ValueError`` if the convention cannot hold its skew."""
    if abs(pinhole.skew) > _RELATIVE_TOLERANCE * pinhole.fx:
        raise ValueError(f"camera must have no skew, got {pinhole.skew!r} pixels")
    return pinhole


def _check_square_pixels(what: str, one: float, other: float) -> None:
    """Raise ``ValueError`` if the camera's pixels are not square."""
    if abs(one - other) > _RELATIVE_TOLERANCE * max(abs(one), abs(other)):
        raise ValueError(f"camera must have square pixels, got {what} {one!r} and {other!r}")


def _drop_batch_axis(name: str, value: Any, dimensions: int) -> NDArray[Any]:
    """Return an array, or a tensor's, without a leading axis of length 1."""
    array = unmasked_array(name, value)
    return array[0] if array.ndim == dimensions + 1 and len(array) == 1 else array
