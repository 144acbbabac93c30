"""Programs that import pyrender run unedited; those that reach for OpenGL are told what to use."""

from __future__ import annotations

import math
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import trimesh

from rasterjit.compat import pyrender
from rasterjit.compat.pyrender.font import Character, Font, FontCache
from rasterjit.compat.pyrender.platforms import egl
from rasterjit.compat.pyrender.shader_program import ShaderProgram, ShaderProgramCache
from rasterjit.scene.transforms import rotate_y, translate

W, H = 48, 36


def run(*arguments, code=None, cwd=None):
    """Run Python with arguments, or with code."""
    arguments = ("-c", textwrap.dedent(code)) if code else arguments
    return subprocess.run(
        [sys.executable, "-W", "error", *map(str, arguments)],
        capture_output=True, text=True, check=False, cwd=cwd,
    )  # fmt: skip


def run_program(*arguments, cwd=None):
    return run("-m", "rasterjit.compat.pyrender", *arguments, cwd=cwd)


def test_installed_adapter_is_pyrender_with_all_its_modules():
    done = run(
        code="""
        import importlib.util
        import sys
        from rasterjit.compat.pyrender import install
        install()
        # Some programs ask whether it was imported already.
        assert "pyrender" not in sys.modules
        assert importlib.util.find_spec("pyrender").name == "pyrender"
        assert importlib.util.find_spec("pyrender.nothing") is None
        import pyrender, pyrender.light, pyrender.platforms.egl
        from pyrender import Mesh
        from pyrender.constants import RenderFlags
        from pyrender.trackball import Trackball
        from pyrender.mesh import Mesh as Same
        assert pyrender is sys.modules["rasterjit.compat.pyrender"]
        assert Same is Mesh and pyrender.light.DirectionalLight is pyrender.DirectionalLight
        assert pyrender.viewer.Viewer is pyrender.Viewer
        install()
        assert sys.modules["pyrender"] is pyrender
        import pyrender.shader_program, pyrender.renderer, pyrender.utils, pyrender.font
        assert sys.modules["pyrender.font"] is sys.modules["rasterjit.compat.pyrender.font"]
        assert pyrender.font.FontCache is pyrender.renderer.FontCache
        assert pyrender.__spec__.name == "rasterjit.compat.pyrender"
        # The fork that urchin shows robots by.
        import pyribbit, pyribbit.light
        assert pyribbit is pyrender and sys.modules["pyribbit.light"] is pyrender.light
        print(pyrender.__version__)
        """
    )
    assert (done.returncode, done.stdout) == (0, "0.1.45\n"), done.stderr


def test_install_is_refused_where_pyrender_itself_is_there(tmp_path):
    (tmp_path / "pyrender.py").write_text("'''Another.'''\n")
    done = run(
        code=f"""
        import sys
        sys.path.insert(0, {str(tmp_path)!r})
        import pyrender
        from rasterjit.compat.pyrender import install
        try:
            install()
        except RuntimeError as error:
            print(error)
        assert pyrender.__doc__ == "Another." and sys.modules["pyrender"] is pyrender
        """
    )
    assert done.returncode == 0, done.stderr
    assert "must come before the first import of pyrender" in done.stdout
    assert str(tmp_path) in done.stdout


PROGRAM = """
import os
import sys
os.environ["PYOPENGL_PLATFORM"] = "egl"

import numpy as np
import pyrender
import trimesh
from beside import NAME
from pyrender.constants import RenderFlags

scene = pyrender.Scene()
scene.add(pyrender.Mesh.from_trimesh(trimesh.creation.box()))
pose = np.eye(4)
pose[2, 3] = 3.0
scene.add(pyrender.PerspectiveCamera(yfov=1.0), pose=pose)
depth = pyrender.OffscreenRenderer(32, 24).render(scene, RenderFlags.DEPTH_ONLY)
print(__name__, NAME, sys.argv[1:], float(depth[12, 16]), sys.modules["__main__"].NAME)
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    (tmp_path / "beside.py").write_text("NAME = 'found'\n")
    return tmp_path


@pytest.mark.parametrize("how", ["file", "module"])
def test_program_runs_unedited(folder, how, tmp_path_factory):
    if how == "file":
        elsewhere = tmp_path_factory.mktemp("elsewhere")
        done = run_program(folder / "program.py", "-m", "--size", "3", cwd=elsewhere)
    else:
        done = run_program("-m", "program", "-m", "--size", "3", cwd=folder)
    expected = "__main__ found ['-m', '--size', '3'] 2.5 found\n"
    assert (done.returncode, done.stdout) == (0, expected), done.stderr


@pytest.mark.parametrize(
    ("ending", "status", "said"),
    [
        ("raise SystemExit(3)", 3, ""),
        ("import sys; sys.exit('too late')", 1, "too late\n"),
        ("raise KeyboardInterrupt", 130, "KeyboardInterrupt\n"),
        ("import atexit; atexit.register(print, 'bye'); 1 / 0", 1,
         "ZeroDivisionError: division by zero\n"),
        ("def broken(:", 1, "SyntaxError: invalid syntax\n"),
    ],
)  # fmt: skip
def test_program_ends_as_it_would_by_itself(tmp_path, ending, status, said):
    (tmp_path / "program.py").write_text(f"{ending}\n")
    arguments = ["-m", "program"] if "exit" in ending else ["program.py"]
    done = run_program(*arguments, cwd=tmp_path)
    assert done.returncode == status
    assert done.stderr.endswith(said)
    # What runs the program is not among the steps.
    assert "rasterjit" not in done.stderr
    assert "runpy" not in done.stderr
    assert ("bye" in done.stdout) == ("bye" in ending)


def test_steps_of_an_error_are_those_of_the_program(tmp_path):
    (tmp_path / "program.py").write_text("def inner():\n    return {}['key']\n\ninner()\n")
    by_itself = run("program.py", cwd=tmp_path)
    done = run_program("program.py", cwd=tmp_path)
    assert done.stderr == by_itself.stderr


def test_processes_that_a_program_starts_have_it_too(tmp_path):
    (tmp_path / "program.py").write_text(
        textwrap.dedent(
            """
            import multiprocessing
            import subprocess
            import sys

            class Job:
                size = 3

            def work(job):
                import pyrender.mesh
                return pyrender.mesh.Mesh.__module__, job.size

            if __name__ == "__main__":
                with multiprocessing.get_context("spawn").Pool(1) as pool:
                    print(pool.map(work, [Job()]))
                code = "import pyribbit.node; print(pyribbit.node.Node.__module__)"
                print(subprocess.check_output([sys.executable, "-c", code], text=True))
            """
        )
    )
    done = run_program("program.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "('rasterjit.compat.pyrender.mesh', 3)" in done.stdout
    assert "rasterjit.compat.pyrender.node" in done.stdout


def test_command_says_how_it_is_used():
    for arguments, status in (((), 2), (("-m",), 2), (("--help",), 0)):
        done = run_program(*arguments)
        assert done.returncode == status
        assert "usage: python -m rasterjit.compat.pyrender" in done.stdout + done.stderr
    done = run_program("no_such_program.py")
    assert done.returncode == 2
    assert "can't open file" in done.stderr


def lit_box():
    """A unit box, turned by 30 degrees, before a camera that looks along x."""
    scene = pyrender.Scene()
    node = scene.add(pyrender.Mesh.from_trimesh(trimesh.creation.box(), smooth=False))
    scene.set_pose(node, rotate_y(90.0))
    pose = rotate_y(90.0) @ translate((0, 0, 3))
    scene.add(pyrender.PerspectiveCamera(math.pi / 3), pose=pose)
    return scene, node


@pytest.fixture
def renderer():
    made = pyrender.OffscreenRenderer(W, H)
    yield made
    made.delete()


def test_parts_of_opengl_say_what_to_use_instead(renderer):
    inner = renderer._renderer
    assert not hasattr(inner, "_program_cache")
    assert getattr(inner, "_program_cache", None) is None
    for reach in (
        lambda: inner._program_cache,
        lambda: setattr(inner, "_program_cache", 3),
        lambda: inner._forward_pass(None, 0),
        lambda: ShaderProgramCache(shader_dir="shaders"),
        lambda: ShaderProgram("mesh.vert", "mesh.frag"),
        lambda: FontCache(),
        lambda: Font("a.ttf"),
        lambda: Character(None, None, None, None),
        lambda: inner.render_text("Hello", 0, 0),
    ):
        with pytest.raises(pyrender.NoOpenGLError, match=r"render\(scene, outputs=\.\.\.\)"):
            reach()
    with pytest.raises(AttributeError, match="no attribute 'colour'"):
        _ = inner.colour


def test_renderers_with_own_passes_are_refused():
    class Own(pyrender.Renderer):
        def _forward_pass(self, scene, flags, seg_node_map=None):
            return None

    with pytest.raises(pyrender.NoOpenGLError, match=r"Own\._forward_pass"):
        Own(W, H)

    class Plain(pyrender.Renderer):
        def twice(self):
            return 2 * self.viewport_width

    assert Plain(W, H).twice() == 2 * W


def test_inner_renderer_draws_the_same(renderer):
    scene, node = lit_box()
    flags = pyrender.RenderFlags.OFFSCREEN | pyrender.RenderFlags.SKIP_CULL_FACES
    for inner in (renderer._renderer, pyrender.Renderer(W, H, point_size=2.0)):
        color, depth = inner.render(scene, flags)
        for found, wanted in zip((color, depth), renderer.render(scene), strict=True):
            np.testing.assert_array_equal(found, wanted)
        assert inner.render(scene, pyrender.RenderFlags.NONE) is None
        np.testing.assert_array_equal(inner.read_depth_buf(), depth)
        np.testing.assert_array_equal(inner.read_color_buf(), color)
        seg, _ = inner.render(scene, flags | pyrender.RenderFlags.SEG, {node: 7})
        assert seg.max() == 7
    inner.viewport_width = 20
    assert inner.render(scene, flags)[0].shape == (H, 20, 3)
    with pytest.raises(ValueError, match="render must come before read_color_buf"):
        pyrender.Renderer(W, H).read_color_buf()
    with pytest.raises(ValueError, match="render must come before read_depth_buf"):
        pyrender.Renderer(W, H).read_depth_buf()
    inner.delete()


def test_platforms_do_nothing(renderer):
    device = egl.get_device_by_index(7)
    assert egl.query_devices()
    assert "CPU" in repr(egl.get_default_device())
    for platform in (renderer._platform, egl.EGLPlatform(W, H, device=device)):
        platform.init_context()
        platform.make_current()
        assert platform.supports_framebuffers()
        assert (platform.viewport_width, platform.viewport_height) == (W, H)
        platform.make_uncurrent()
        platform.delete_context()


def test_normals_and_positions_are_outputs(renderer):
    scene, node = lit_box()
    names = ("normal", "normal_camera", "geometric_normal", "position", "position_camera",
             "distance")  # fmt: skip
    color, depth, extra = renderer.render(scene, outputs=names)
    assert tuple(extra) == names
    middle = H // 2, W // 2
    np.testing.assert_allclose(extra["normal"][middle], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(extra["geometric_normal"][middle], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(extra["normal_camera"][middle], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(extra["position"][middle], [0.5, 0, 0], atol=0.08)
    is_seen = depth > 0
    np.testing.assert_allclose(
        -extra["position_camera"][..., 2][is_seen], depth[is_seen], rtol=1e-6
    )
    assert (np.isfinite(extra["distance"]) == is_seen).all()
    assert extra["distance"][middle] == pytest.approx(2.5, abs=0.01)
    assert np.isnan(extra["position"][~is_seen]).all()
    assert not extra["normal"][~is_seen].any()
    np.testing.assert_array_equal(color, renderer.render(scene)[0])
    alone, extra = renderer.render(scene, pyrender.RenderFlags.DEPTH_ONLY, outputs="normal")
    np.testing.assert_array_equal(alone, depth)
    assert list(extra) == ["normal"]
    seg, _, extra = renderer.render(scene, pyrender.RenderFlags.SEG, {node: 9}, outputs=["normal"])
    assert ((seg[..., 0] == 9) == extra["normal"].any(axis=2)).all()
    _, _, extra = renderer.render(scene, pyrender.RenderFlags.SEG, outputs=names)
    assert not extra["normal"].any()
    assert extra["normal"].shape == (H, W, 3)
    assert np.isinf(extra["distance"]).all()
    assert extra["distance"].shape == (H, W)
