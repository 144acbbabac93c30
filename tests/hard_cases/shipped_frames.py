"""
Draw every recorded frame with the machine code that came with the installation, without compilers.

``python tests/hard_cases/shipped_frames.py [FOLDER ...]`` prints how many frames there are and for
which CPUs the code is. Modules are looked for in the folders first. Ends with status 1, and names
the frames, if some have other hashes or anything was compiled.
"""

from __future__ import annotations

import sys
import warnings

NOT_NEEDED = ("numba", "llvmlite", "trimesh", "imageio", "rich")
"""Packages without which frames are drawn from a wheel."""


class NotInstalled:
    """A finder of modules for which these packages are not installed, wherever they may be."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in NOT_NEEDED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def main(folders):
    sys.path[:0] = folders
    sys.meta_path.insert(0, NotInstalled())
    import frames

    from rasterjit.runtime import prebuilt_kernels, store

    # Some are cut, out of view, or rounded off, on purpose.
    warnings.simplefilter("ignore")
    found, recorded = dict(frames.every_digest()), frames.recorded()
    library, problem = prebuilt_kernels.found()
    wrong = sorted(name for name in recorded if found.get(name) != recorded[name])
    if wrong or store.USED.compiled or library is None:
        sys.exit(f"other hashes: {wrong}; compiled: {store.USED.compiled}; {problem}")
    print(f"{len(found)} frames by {library.target.triple}, {library.target.cpu}")


if __name__ == "__main__":
    main(sys.argv[1:])
