"""
Render on more than one machine with Dask, and pictures and meshes too large for one.

``rasterjit.render_many(..., client=client)``
    Many cameras, one scene: the scene goes to every machine once, frames come back in order, and no
    more of them are under way than ``prefetch``. With ``then=function`` comes back what a function
    makes of each frame on its machine.
`render_partitions`
    One camera, a mesh too large for one machine: parts of it are drawn where they are, and the
    nearest faces kept (sort-last).
`render_large`
    One camera, a picture too large for one: it is drawn and written tile by tile.

All give the bits that one machine gives, on any number of workers, and when workers are lost: their
tasks are run again elsewhere.

Needs ``pip install "rasterjit[distributed]"``.

Deployment
----------
A function takes any ``distributed.Client``, so any cluster that Dask can start will do: by hand
(``dask scheduler`` and ``dask worker``), by SSH, Kubernetes, a batch queue or a cloud. All machines
need the same versions of Python, RasterJIT and its dependencies. Without a client `render_many` and
`render_large` draw in this process, and `render_partitions` makes a ``LocalCluster``, one process
for each processor, and closes it at the end; programs that have one made, or make one themselves,
must keep what they run behind ``if __name__ == "__main__":``.

- Start workers with one thread (``--nthreads 1``) and as many of them as processors: a task draws
  with one thread. Where the scene is large, start fewer workers with more threads: threads of a
  worker share the scene.
- Set a memory limit (``--memory-limit``) with room for the scene twice, once as it is sent and once
  as it is prepared, and a few frames. A worker that goes beyond 95 % of it is killed and
  restarted by its nanny, and its tasks are run again; a task that has lost four workers fails.
- Compile first: ``rasterjit warmup`` once for each machine, or a cache of kernels that all of them
  see (``RASTERJIT_CACHE_DIR``). Otherwise the first task of each worker takes a minute or more.
- An adaptive cluster (``cluster.adapt(minimum=1, maximum=100)``) grows with what waits. How much
  waits is what ``prefetch`` allows: with an adaptive cluster pass two for each worker that it may
  have.
- The scheduler keeps nothing on disk: without it all is lost, and a ``ConnectionError`` says so
  when a client has looked for it for ten seconds. Started again, it works with a new client.
- Data that is lost with all workers that held it is sent again; the logger says so once, as a
  warning.

The dashboard's address is logged by the logger ``rasterjit.distributed`` (level INFO). It shows
what the cluster does if ``bokeh`` is installed where the scheduler runs, and else says that it is
missing; nothing else needs it. The dashboard of the cluster that `render_partitions` makes can be
reached from this machine alone.
"""

from rasterjit.distributed.frames import render_large
from rasterjit.distributed.sort_last import render_partitions

__all__ = ["render_large", "render_partitions"]
