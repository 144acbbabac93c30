"""
Fill gaps of Wine that keep Windows' packages from being loaded.

``python .ci/wine_gaps.py FOLDER`` takes a folder with ``python.exe``. Wine's C library lacks parts
of complex numbers, which NumPy and Numba need: their extension modules get another library, whose
name is as long. It has these functions, and passes all others on to Wine's. The library of random
numbers, which Rust's programs need (lazrs), is missing: a new one passes on to another of Wine's.
Needs pefile and ziglang.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pefile

LIBRARY, STAND_IN = b"api-ms-win-crt-math-l1-1-0.dll", b"xpi-ms-win-crt-math-l1-1-0.dll"

SOURCE = """
typedef struct { float real, imaginary; } Single;
typedef struct { double real, imaginary; } Double;
float crealf(Single z) { return z.real; }
float cimagf(Single z) { return z.imaginary; }
double creal(Double z) { return z.real; }
double cimag(Double z) { return z.imaginary; }
double creall(Double z) { return z.real; }
double cimagl(Double z) { return z.imaginary; }
int DllMainCRTStartup(void *module, unsigned reason, void *reserved) { return 1; }
"""

MISSING = {"crealf", "cimagf", "creal", "cimag", "creall", "cimagl"}

RANDOM = "bcryptprimitives.dll"
RANDOM_EXPORTS = ["ProcessPrng = advapi32.SystemFunction036"]

UNUSABLE = ("DLLs/_wmi.pyd",)
"""Asks Wine for facts on the system that end the process; Python does without."""


def imported_names(path: Path) -> set[str]:
    """Return the names that an extension module takes from the library."""
    with pefile.PE(str(path), fast_load=True) as module:
        module.parse_data_directories([pefile.DIRECTORY_ENTRY["IMAGE_DIRECTORY_ENTRY_IMPORT"]])
        return {
            one.name.decode()
            for library in getattr(module, "DIRECTORY_ENTRY_IMPORT", [])
            if library.dll.lower() == LIBRARY
            for one in library.imports
        }


def make_library(path: Path, exports: list[str]) -> None:
    """Make a library of functions of the source above, and of others that Wine has."""
    with tempfile.TemporaryDirectory() as place:
        source, definitions = Path(place, "parts.c"), Path(place, "parts.def")
        source.write_text(SOURCE)
        definitions.write_text("\n".join([f"LIBRARY {path.name}", "EXPORTS", *exports, ""]))
        build = "-m ziglang cc -target x86_64-windows-gnu -O1 -fno-builtin -shared -nostdlib -o"
        made = Path(place, path.name)
        subprocess.run([sys.executable, *build.split(), made, source, definitions], check=True)
        shutil.copy(made, path)


def main(folder: Path) -> None:
    """Fill the gaps of a folder."""
    for name in UNUSABLE:
        (folder / name).unlink(missing_ok=True)
    names: set[str] = set()
    for path in folder.glob("Lib/site-packages/num[pb]*/**/*.pyd"):
        found = imported_names(path)
        if found & MISSING:
            names |= found
            path.write_bytes(path.read_bytes().replace(LIBRARY, STAND_IN))
            print(path.relative_to(folder))
    exports = [name if name in MISSING else f"{name} = ucrtbase.{name}" for name in sorted(names)]
    make_library(folder / STAND_IN.decode(), exports)
    make_library(folder / RANDOM, RANDOM_EXPORTS)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
