"""
Draw every recorded frame with the machine code that came with the installation, without Numba.

``python tests/hard_cases/shipped_frames.py [FOLDER ...]`` prints how many frames there are and for
which CPUs the code is. Modules are looked for in the folders first. Ends with status 1, and names
the frames, if some have other hashes or anything was compiled.
"""

from __future__ import annotations

import sys
import warnings


class NoNumba:
    """A finder of modules for which Numba is not installed, wherever it may be."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "numba":
            raise ModuleNotFoundError("No module named 'numba'", name="numba")


def main(folders):
    sys.path[:0] = folders
    sys.meta_path.insert(0, NoNumba())
    import frames

    from rasterjit.runtime import prebuilt_kernels, store

    # Some are cut, out of view, or rounded off, on purpose.
    warnings.simplefilter("ignore")
    found, recorded = dict(frames.every_digest()), frames.recorded()
    pack, problem = prebuilt_kernels.found()
    wrong = sorted(name for name in recorded if found.get(name) != recorded[name])
    if wrong or store.USED.compiled or pack is None:
        sys.exit(f"other hashes: {wrong}; compiled: {store.USED.compiled}; {problem}")
    print(f"{len(found)} frames by {pack.target.triple}, {pack.target.cpu}")


if __name__ == "__main__":
    main(sys.argv[1:])
