"""
Measure how fast many pictures of one scene are drawn: by threads, and by processes of a cluster.

``python -m benchmarks.many [--frames N] [--rounds N] [--size W H] [--price P] [--output FILE]``

Draws the teapot from all sides with `rasterjit.render_many`: by one renderer that has all threads,
and by renderers of one thread each; then on a cluster of one worker process and of two. Ways that
are compared take turns, and the fastest round of each counts: the one that other programs disturbed
least. Then prints what a million frames take on clusters of several sizes, by a model of the
measured numbers: each worker draws as fast as one of the two did; the scheduler and the client see
to one frame after the other, in no less time than a task without work takes and the bytes of a
frame take to come here.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import rasterjit as rj
from benchmarks.report import machine
from rasterjit.runtime.threads import available_processors

MILLION = 1_000_000
CLUSTERS = (1, 2, 8, 32, 128, 512)
TASKS = 500
"""Tasks without work that the cost of one is the mean of."""

TRANSFER = 32 << 20
"""Bytes that the rate of transfers is measured with."""


def teapot() -> rj.Scene:
    """Return the scene."""
    return rj.load(Path(__file__).parent.parent / "models" / "teapot.obj")


def around(scene: rj.Scene, count: int) -> Iterator[Any]:
    """Yield cameras around the scene."""
    for n in range(count):
        direction = rj.orbit_direction(360.0 * n / count, 20.0)
        yield rj.fit_camera(scene, direction=direction)


def seconds_of(draw: Callable[[], Any]) -> float:
    """Return how long drawing takes."""
    started = time.perf_counter()
    draw()
    return time.perf_counter() - started


def processor_seconds(draw: Callable[[], Any], rounds: int) -> float:
    """Return how long processors work for drawing, all threads together; the median of rounds."""
    values = []
    for _ in range(rounds):
        started = time.process_time()
        draw()
        values.append(time.process_time() - started)
    return statistics.median(values)


def take_turns(ways: dict[str, Callable[[], Any]], rounds: int, frames: int) -> dict[str, float]:
    """Return the frames a second of each way: the best of rounds in which all take turns."""
    for draw in ways.values():
        draw()
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for number in range(rounds):
        order = list(ways) if number % 2 == 0 else list(reversed(ways))
        for name in order:
            seconds[name].append(seconds_of(ways[name]))
    return {name: frames / min(values) for name, values in seconds.items()}


def measure_threads(
    scene: rj.Scene, size: tuple[int, int], frames: int, rounds: int
) -> dict[str, float]:
    """Return the frames a second of one renderer with all threads, and of one for each."""
    threads = available_processors()
    cameras = list(around(scene, frames))

    def draw(workers: int) -> Callable[[], Any]:
        def draw_all() -> None:
            for _ in rj.render_many(scene, cameras, size=size, threads=threads, workers=workers):
                pass

        return draw_all

    ways = {"one renderer": draw(1), "one a thread": draw(threads)}
    found = take_turns(ways, rounds, frames)
    # What other programs on the machine change least.
    for name, draw_all in ways.items():
        found[f"{name}, processor seconds"] = processor_seconds(draw_all, rounds) / frames
    return found


def measure_cluster(
    scene: rj.Scene, size: tuple[int, int], frames: int, rounds: int
) -> dict[str, float]:
    """Return what one and two worker processes draw, and what a task and a transfer cost."""
    from contextlib import ExitStack

    from distributed import Client, LocalCluster

    from rasterjit.distributed.frames import draw_frames, share_scene
    from rasterjit.rendering.planning import FrameRequest

    cameras = list(around(scene, frames))
    with ExitStack() as stack:
        clients = []
        for workers in (1, 2):
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True,
                dashboard_address="127.0.0.1:0",
            )  # fmt: skip
            stack.enter_context(cluster)
            clients.append(stack.enter_context(Client(cluster, set_as_default=False)))

        def draw(client: Any) -> Callable[[], Any]:
            def draw_all() -> None:
                for _ in rj.render_many(scene, cameras, size=size, client=client):
                    pass

            return draw_all

        ways = {"1 worker": draw(clients[0]), "2 workers": draw(clients[1])}
        found = take_turns(ways, rounds, frames)
        found["seconds a task"] = task_seconds(clients[1])
        found["bytes a second"] = transfer_rate(clients[1])
    options = FrameRequest(size, rj.Quality.standard(), ("color",), None, "none")
    found["bytes a frame"] = size_sent(draw_frames(share_scene(scene, options, 1), cameras[:1])[0])
    return found


def task_seconds(client: Any) -> float:
    """Return how long a task takes that has nothing to do, one of many."""
    seconds = seconds_of(
        lambda: client.gather([client.submit(int, pure=False) for _ in range(TASKS)])
    )
    return seconds / TASKS


def transfer_rate(client: Any) -> float:
    """Return how many bytes come from a worker in a second."""
    future = client.submit(np.ones, TRANSFER, np.uint8, pure=False)
    future.result()
    return TRANSFER / statistics.median(seconds_of(future.result) for _ in range(5))


def size_sent(value: Any) -> int:
    """Return how many bytes a value has on its way."""
    from distributed.protocol import serialize

    header, parts = serialize(value, serializers=("dask", "pickle"))
    return len(json.dumps(header, default=str)) + sum(memoryview(part).nbytes for part in parts)


def model(found: dict[str, float]) -> list[tuple[int, float, float, str]]:
    """Return workers, seconds and processor-hours of a million frames, and what bounds them."""
    serial = found["seconds a task"] + found["bytes a frame"] / found["bytes a second"]
    rows = []
    for workers in CLUSTERS:
        rate = found["1 worker"] if workers == 1 else workers * found["2 workers"] / 2.0
        drawing = MILLION / rate
        waiting = MILLION * serial
        bound = "drawing" if drawing >= waiting else "scheduler and client"
        seconds = max(drawing, waiting)
        rows.append((workers, seconds, seconds * workers / 3600.0, bound))
    return rows


def main() -> None:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--size", type=int, nargs=2, default=(512, 512))
    parser.add_argument("--price", type=float, help="of one processor for an hour")
    parser.add_argument("--output", type=Path, help="a JSON file")
    arguments = parser.parse_args()
    scene, size = teapot(), tuple(arguments.size)
    found = measure_threads(scene, size, arguments.frames, arguments.rounds)
    found |= measure_cluster(scene, size, arguments.frames, arguments.rounds)
    print(f"{size[0]} x {size[1]}, {available_processors()} processors")
    for name in ("one renderer", "one a thread", "1 worker", "2 workers"):
        print(f"{name:<16}{found[name]:10.1f} frames/s")
    print(
        f"one renderer a thread / one with all: {found['one a thread'] / found['one renderer']:.2f}"
    )
    for name in ("one renderer", "one a thread"):
        print(f"{name}: {1e3 * found[f'{name}, processor seconds']:.2f} processor-ms a frame")
    print(f"2 workers / 1 worker: {found['2 workers'] / found['1 worker']:.2f}")
    print(f"a frame is {found['bytes a frame'] / 2**20:.2f} MiB on its way")
    print(f"{found['bytes a second'] / 2**20:.0f} MiB/s from a worker")
    print(f"{1e3 * found['seconds a task']:.2f} ms a task without work")
    print("\na million frames, by the model:")
    rows = model(found)
    for workers, seconds, hours, bound in rows:
        price = "" if arguments.price is None else f", costs {hours * arguments.price:.2f}"
        print(
            f"{workers:>4} workers: {seconds / 3600.0:8.2f} h, {hours:8.2f} processor-hours"
            f"{price}; bound by {bound}"
        )
    if arguments.output is not None:
        content = {"machine": machine(), "size": size, "found": found, "model": rows}
        arguments.output.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
