"""Draw many frames of one scene on a cluster: the worker's side and the client's."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from rasterjit import plan as planning
from rasterjit.distributed.clusters import SharedScene, check_client, result_of, retried, send
from rasterjit.frame import Frame, Stats
from rasterjit.plan import RenderPlan
from rasterjit.render import Renderer
from rasterjit.scene.camera import Camera
from rasterjit.scene.scene import Scene
from rasterjit.streams import AHEAD, Options, check_prefetch, in_order, with_bar
from rasterjit.validation import thread_count

if TYPE_CHECKING:
    from distributed import Client, Future

Drawn = tuple[dict[str, NDArray[Any]], Stats]
"""What a worker sends back of a frame."""


class FarFrame(Frame):
    """A frame that a worker drew; its plan is made here, when it is first asked for."""

    def __init__(self, drawn: Drawn, scene: Scene, camera: Camera, options: Options) -> None:
        self._plan: RenderPlan | None = None
        self._asked = scene, camera, options
        super().__init__(drawn[0], None, drawn[1])

    @property
    def plan(self) -> RenderPlan:
        """What was decided for this frame."""
        if self._plan is None:
            scene, camera, options = self._asked
            self._plan = planning.plan_render(
                scene, camera, options.size, options.quality, options.outputs, options.background,
                options.cull,
            )  # fmt: skip
        return self._plan

    @plan.setter
    def plan(self, value: RenderPlan | None) -> None:
        self._plan = value


def share_scene(scene: Scene, options: Options, threads: int) -> SharedScene:
    """Return what all frames have in common; ``threads`` are those of each task."""
    return SharedScene(_renderer, scene, options, threads)


def _renderer(scene: Scene, options: Options, threads: int) -> Renderer:
    """Return a renderer on a worker."""
    return Renderer(options.size, quality=options.quality, threads=threads)


def draw_frame(shared: SharedScene, camera: Camera) -> Drawn:
    """Draw a frame on a worker, which keeps what frames of one scene have in common."""
    scene, options, _ = shared.arguments
    with shared.renderer() as renderer:
        frame = renderer.render(
            scene, camera, outputs=options.outputs, background=options.background, cull=options.cull
        )
    # Counted where the faces are: they do not travel for it.
    _ = frame.stats.pixels_covered
    return frame.arrays(), frame.stats


class Farm:
    """
    The frames of one scene that a cluster draws.

    Parameters
    ----------
    client : Client
    scene : Scene
    options : Options
    threads : int
        Of each task.
    """

    def __init__(self, client: Client, scene: Scene, options: Options, threads: int) -> None:
        self._client, self._scene, self._options = client, scene, options
        self._shared = share_scene(scene, options, threads)
        self._sent: Future | None = None
        self._begun: dict[int, Future] = {}
        self._count = 0

    def __enter__(self) -> Farm:
        self._send()
        return self

    def __exit__(self, *error: Any) -> None:
        if self._client.status == "running":
            self._client.cancel([*self._begun.values(), self._sent], force=True)
        self._begun.clear()
        self._sent = None

    def submit(self, camera: Camera) -> tuple[int, Camera]:
        """Begin a frame."""
        self._count += 1
        self._begin(self._count, camera)
        return self._count, camera

    def take(self, begun: tuple[int, Camera]) -> Frame:
        """Return a frame when it is done, wherever that is."""
        number, camera = begun

        def again() -> None:
            # An earlier frame may have seen to it already.
            if self._sent.status != "finished":
                self._send()
            self._begin(number, camera)

        drawn = retried(lambda: result_of(self._begun[number], self._client), "the scene", again)
        del self._begun[number]
        return FarFrame(drawn, self._scene, camera, self._options)

    def _begin(self, number: int, camera: Camera) -> None:
        """Send a task; those of earlier frames go first."""
        self._begun[number] = self._client.submit(
            draw_frame, self._sent, camera, pure=False, priority=-number
        )

    def _send(self) -> None:
        """Send the scene to every worker."""
        self._sent = send(self._shared, self._client)


def farm_out(
    scene: Scene,
    cameras: Iterable[Camera],
    options: Options,
    threads: int | None,
    prefetch: int | None,
    progress: str,
    client: Client,
) -> Iterator[Frame]:
    """Yield frames in the order of the cameras; see `rasterjit.render_many`."""
    client = check_client(client)
    own = thread_count("threads", threads) or 1
    most = check_prefetch(prefetch) or AHEAD * max(1, sum(client.nthreads().values()))
    farm = Farm(client, scene, options, own)
    return with_bar(_draw_all(farm, cameras, most), cameras, progress)


def _draw_all(farm: Farm, cameras: Iterable[Camera], prefetch: int) -> Iterator[Frame]:
    """Draw frames by a farm that is there as long as frames are taken."""
    with farm:
        yield from in_order(cameras, farm.submit, farm.take, prefetch)
