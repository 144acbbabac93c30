"""Run programs one after the other, each as the main one, and mark where each begins."""

import runpy
import sys

BEGIN = "-- program "

if __name__ == "__main__":
    names = sys.argv[1:]
    sys.path[0] = ""  # The folder in which they run.
    for name in names:
        sys.argv = [name]
        print(f"{BEGIN}{name}", flush=True)
        runpy.run_path(name, run_name="__main__")
