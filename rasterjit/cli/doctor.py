"""Look at the installation and check, on tiny scenes with known answers, that rendering works."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.meshes import EXTRA_MODULES
from rasterjit.outputs.output_table import OUTPUTS
from rasterjit.rendering.rasterize import RasterizedFaces, rasterize
from rasterjit.rendering.renderer import render
from rasterjit.runtime import clocks, jit, prebuilt_kernels, store
from rasterjit.runtime.threads import available_processors
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.previous_view import PreviousView
from rasterjit.scene.scene import Scene

PACKAGES = ("rasterjit", "numpy", "numba", "llvmlite", "trimesh", "imageio")

EXTRAS = {
    "formats": EXTRA_MODULES,
    "cameras": ("yaml",),
    "clouds": ("laspy", "lazrs"),
    "vtk": ("meshio",),
    "robots": ("yourdfpy",),
    "gltf": ("DracoPy", "opengl_basisu", *(("meshopt",) if sys.version_info >= (3, 11) else ())),
    "video": ("imageio_ffmpeg",),
    "animation": ("scipy",),
    "exr": ("OpenEXR",),
    "accuracy": ("matplotlib", "jinja2", "flip_evaluator"),
    "viewer": ("rendercanvas", "glfw", "wgpu"),
    "viewer-qt": ("rendercanvas", "PySide6"),
    "browser": ("uvicorn", "websockets", "simplejpeg"),
    "terminal": ("blessed",),
    "notebook": ("rendercanvas", "anywidget", "simplejpeg"),
    "mpl": ("matplotlib",),
    "mujoco": ("mujoco",),
    "pybullet": ("pybullet",),
    "distributed": ("dask", "distributed"),
    "large": ("tifffile",) if sys.version_info < (3, 11) else ("tifffile", "zarr"),
}
"""Modules that each optional extra brings."""

SHOWN_FEATURES = ("sse4.2", "avx", "avx2", "fma", "avx512f", "avx512bw", "neon", "sve")

PICTURE_SIDE = 16
"""Width and height of the checks' pictures, pixels."""

DEPTH_TOLERANCE = 2.0**-22
"""Relative tolerance of depth: four roundings of float32."""


class Finding(NamedTuple):
    """One line of the report."""

    name: str
    text: str
    passed: bool | None = None
    """``None`` if the line is not a check."""


def examine() -> Iterator[Finding]:
    """Yield the findings: what is installed first, then the checks."""
    yield Finding("python", f"{platform.python_version()} on {platform.platform(terse=True)}")
    for package in PACKAGES:
        yield _find_version(package)
    name, features = store.host_cpu_features() if store.has_linker() else (platform.machine(), None)
    shown = [feature for feature in SHOWN_FEATURES if feature in (features or ())]
    units = " ".join(shown) or "none of the usual vector units"
    yield Finding("cpu", name if features is None else f"{name}: {units}")
    yield Finding("threads", f"{available_processors()} of {os.cpu_count()} processors")
    for extra, modules in EXTRAS.items():
        yield _find_extra(extra, modules)
    for check in CHECKS:
        yield _run_check(check)
    yield _find_kernel_source()
    yield from _check_prebuilt_kernels()
    yield from _check_store()


def _find_version(package: str) -> Finding:
    """Return the version of a required package."""
    try:
        return Finding(package, importlib.metadata.version(package))
    except importlib.metadata.PackageNotFoundError:
        # It runs from a folder of sources, or its metadata is lost; importing it worked.
        return Finding(package, "not installed as a package", None)


def _find_extra(extra: str, modules: tuple[str, ...]) -> Finding:
    """Say which modules of an optional extra are missing."""
    missing = [module for module in modules if importlib.util.find_spec(module) is None]
    if not missing:
        return Finding(f"extra {extra}", "present")
    lacks = f"without {', '.join(missing)}"
    return Finding(f"extra {extra}", f'{lacks} (optional: pip install "rasterjit[{extra}]")')


def _run_check(check: Callable[[], Finding]) -> Finding:
    """Run a check; one that raises has failed."""
    try:
        return check()
    except Exception as error:
        name = check.__name__.removeprefix("check_").replace("_", " ")
        return Finding(name, f"{type(error).__name__}: {error}", False)


def _find_kernel_source() -> Finding:
    """Report whether the checks' kernels were compiled or loaded."""
    if jit.DISABLED:
        return Finding("kernels", "not compiled: NUMBA_DISABLE_JIT is set (very slow)")
    if jit.CHECKED:
        return Finding("kernels", "with checked indices: NUMBA_BOUNDSCHECK is set (not kept)")
    loaded, compiled = map(len, store.USED_KERNELS)
    took = f"{loaded} loaded, {compiled} compiled in {clocks.COMPILER_CLOCK.seconds:.1f} s"
    return Finding("kernels", took + (" (rasterjit warmup compiles the rest)" if compiled else ""))


def _check_prebuilt_kernels() -> Iterator[Finding]:
    """Check the machine code that came with the installation, if any."""
    if jit.DISABLED or jit.CHECKED:
        return
    library, problem = prebuilt_kernels.find_library()
    if problem is not None:
        yield Finding("shipped code", problem, False)
    if library is not None:
        yield _describe_shipped("code", library.target.cpu, library.index, library.path)
    elif store.has_linker():
        lowered, problem = prebuilt_kernels.find_texts()
        if problem is not None:
            yield Finding("shipped text", problem, False)
        if lowered is not None:
            yield _describe_shipped("text", lowered.cpu, lowered.index, lowered.path)


def _describe_shipped(what: str, cpu: str, index: prebuilt_kernels.Index, path: Path) -> Finding:
    """Describe a file of kernels that came with the installation."""
    size = f"{len(index.forms)} forms, {path.stat().st_size / 1e6:.1f} MB"
    return Finding(f"shipped {what}", f"{cpu}, {size}, made with {index.made_with}; {path}", True)


def _check_store() -> Iterator[Finding]:
    """Check the store, remove damaged entries, and report its contents."""
    if jit.DISABLED or jit.CHECKED:
        return
    place = store.kernel_folder() if store.has_linker() else None
    if (
        place is None
        and prebuilt_kernels.find_library().library
        and not store.USED_KERNELS.compiled
    ):
        yield Finding("kernel store", "nothing is kept, and nothing need be")
        return
    if place is None:
        remedy = f"set {store.FOLDER_VARIABLE}" if store.has_linker() else "pip install numba"
        yield Finding("kernel store", f"nothing is kept ({remedy})", False)
        return
    found = store.inspect_folder(place)
    left = store.remove_damaged(found)
    text = f"{found.entries} entries, {found.size / 1e6:.1f} MB; {place}"
    others = {
        "made by other versions": found.other_versions,
        "for other processors": found.other_cpus,
        "from other sources": found.other_sources,
    }
    of_them = [f"{count} {what}" for what, count in others.items() if count]
    is_kept = not store.USED_KERNELS.compiled or os.access(place, os.W_OK)
    unkept = "" if is_kept else f" cannot be written (set {store.FOLDER_VARIABLE})"
    yield Finding("kernel store", text + unkept, is_kept)
    if of_them:
        yield Finding("", f"of them {', '.join(of_them)}: of no use here, no harm")
    removed = sum(path not in left and not path.exists() for path in found.damaged)
    if removed:
        yield Finding("", f"{removed} damaged removed: compiled again when needed")
    removed = sum(path not in left and not path.exists() for path in found.temporary)
    if removed:
        yield Finding("", f"{removed} temporary files removed")
    for path in (*left, *found.unreadable):
        what = "cannot be removed" if path in left else "cannot be read"
        yield Finding("", f"{path.name} {what}: remove it", False)


def check_shared_edge() -> Finding:
    """Draw two triangles that share an edge: every pixel belongs to exactly one."""
    square = [(0, 0), (16, 0), (16, 16), (0, 16)]
    face_id = _draw_pixels(square, [(0, 1, 2), (0, 2, 3)]).face_id
    counts = [int((face_id == face).sum()) for face in (0, 1)]
    passed = counts == [136, 120]
    return Finding(
        "shared edge", f"{counts[0]} + {counts[1]} of {PICTURE_SIDE * PICTURE_SIDE} pixels", passed
    )


def check_top_left_rule() -> Finding:
    """Draw triangles whose edges pass through pixel centres: the known pixels are theirs."""
    square = [(1.5, 1.5), (3.5, 1.5), (3.5, 3.5), (1.5, 3.5)]
    face_id = _draw_pixels(square, [(0, 1, 2), (0, 2, 3)]).face_id
    expected = np.full((PICTURE_SIDE, PICTURE_SIDE), -1, np.int32)
    expected[[1, 1, 2], [1, 2, 2]] = 0
    expected[2, 1] = 1
    passed = bool(np.array_equal(face_id, expected))
    return Finding("top-left rule", "edges through pixel centres", passed)


def check_depth_and_color() -> Finding:
    """Render a red square at a known distance."""
    scene = Scene()
    vertices = [(-9, -9, -3), (9, -9, -3), (9, 9, -3), (-9, 9, -3)]
    material = Material(shading="unlit", base_color="red")
    scene.add(Mesh(vertices, [(0, 1, 2), (0, 2, 3)], material=material))
    camera = PerspectiveCamera(eye=(0, 0, 0), target=(0, 0, -1))
    frame = render(
        scene, camera, size=(PICTURE_SIDE, PICTURE_SIDE), outputs=("color", "depth"), threads=1
    )
    error = float(np.abs(frame.depth / 3.0 - 1.0).max())
    red = bool((frame.color == (255, 0, 0, 255)).all())
    passed = red and error <= DEPTH_TOLERANCE
    return Finding("depth and colour", f"relative error of depth {error:.1e}", passed)


def check_threads() -> Finding:
    """Render a ball of many faces with one and with three threads: the same bits."""
    scene = Scene()
    scene.add(_make_ball(24, 12))
    outputs = tuple(name for name in OUTPUTS if name not in ("uv", "scalar"))
    frames = [
        render(
            scene,
            size=(4 * PICTURE_SIDE, 3 * PICTURE_SIDE),
            outputs=outputs,
            previous=PreviousView(),
            threads=threads,
        ).arrays()
        for threads in (1, 3)
    ]
    different = [name for name in outputs if frames[0][name].tobytes() != frames[1][name].tobytes()]
    covered = int((frames[0]["face_id"] >= 0).sum())
    text = f"differ in {', '.join(different)}" if different else f"same bits ({covered} pixels)"
    return Finding("1 and 3 threads", text, not different and covered > 0)


CHECKS = (check_shared_edge, check_top_left_rule, check_depth_and_color, check_threads)


def _draw_pixels(
    pixels: list[tuple[float, float]], faces: list[tuple[int, int, int]]
) -> RasterizedFaces:
    """Rasterize faces whose vertices are given in pixels, y down."""
    x, y = np.array(pixels, np.float64).T
    ndc = np.stack(
        [2.0 * x / PICTURE_SIDE - 1.0, 1.0 - 2.0 * y / PICTURE_SIDE, 0.0 * x, 0.0 * x + 1.0], axis=1
    )
    return rasterize(ndc, faces, (PICTURE_SIDE, PICTURE_SIDE), threads=1)


def _make_ball(around: int, rows: int) -> Mesh:
    """Return a sphere cut along meridians and parallels; the faces at its poles have no area."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    polar = np.linspace(0.0, np.pi, rows + 1)[:, np.newaxis]
    vertices = np.stack(
        [np.sin(polar) * np.sin(azimuth), np.cos(polar) + 0.0 * azimuth,
         np.sin(polar) * np.cos(azimuth)],
        axis=-1,
    ).reshape(-1, 3)  # fmt: skip
    first = np.arange(rows * around)
    beside = first - first % around + (first + 1) % around
    faces: NDArray[np.int64] = np.concatenate(
        [
            np.stack([first, first + around, beside + around], axis=1),
            np.stack([first, beside + around, beside], axis=1),
        ]
    )
    return Mesh(vertices, faces)
