"""
Draw every recorded frame with what came with the installation, without Numba.

``python tests/hard_cases/shipped_frames.py [--threads=N] [FOLDER ...]`` prints how many frames
there are and for which CPUs the code is. One thread draws unless a number is given. Modules are
looked for in the folders first. It needs no llvmlite where a shared library came; LLVM's text needs
it. Ends with status 1, and names the frames, if some have other hashes, or if anything was compiled
beside a library.
"""

from __future__ import annotations

import argparse
import sys
import warnings

NOT_NEEDED = {"numba", "llvmlite", "trimesh", "imageio", "rich"}
"""Packages without which frames are drawn from a wheel."""


class NotInstalled:
    """A finder of modules for which these packages are not installed, wherever they may be."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in NOT_NEEDED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def main(arguments):
    parser = argparse.ArgumentParser()
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("folders", nargs="*")
    asked = parser.parse_args(arguments)
    sys.path[:0] = asked.folders
    sys.meta_path.insert(0, NotInstalled())
    from rasterjit.runtime import prebuilt_kernels, store

    library, problem = prebuilt_kernels.find_library()
    if library is None:
        NOT_NEEDED.remove("llvmlite")
    texts = None if library else prebuilt_kernels.find_texts().lowered
    import frames

    # Some are cut, out of view, or rounded off, on purpose.
    warnings.simplefilter("ignore")
    found, recorded = dict(frames.every_digest(threads=asked.threads)), frames.recorded()
    wrong = sorted(name for name in recorded if found.get(name) != recorded[name])
    if wrong or (store.USED_KERNELS.compiled and not texts) or not (library or texts):
        sys.exit(f"other hashes: {wrong}; compiled: {store.USED_KERNELS.compiled}; {problem}")
    by = f"{library.target.triple}, {library.target.cpu}" if library else f"text, {texts.cpu}"
    print(f"{len(found)} frames by {by}; threads: {asked.threads}")


if __name__ == "__main__":
    main(sys.argv[1:])
