"""
``python -m benchmarks.house [--against COMMIT]``: how large and how plain the source is.

``--types``: whether mypy finds no more in any room than it may.

One table of counts: lines of code, circles of imports, long signatures, class names with two
meanings, functions without headings, errors of mypy, and what Python does for one small frame.
"""

from __future__ import annotations

import ast
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from benchmarks.checkouts import RevisionError, checkouts
from benchmarks.pairing import package_environment

MAX_PARAMETERS = 10
MAX_LINES_WITHOUT_HEADING = 40

COMPILED = {"kernel", "raw_kernel", "stage", "helper", "disjoint_helper", "intrinsic"}
"""Decorators of what is compiled: its parameters are arrays and numbers, one by one."""
PUBLIC_FILES = ("rasterjit/io/cameras.py",)
"""Files of which everything is public, beside the names in ``__all__``."""
OF_OTHERS = re.compile(r"compat/(pyrender/|mujoco/|pybullet/|bop\.py)")
"""Where names and signatures are those of another package."""
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENDMARKER,
}  # fmt: skip

MAX_TYPE_ERRORS = {
    "accuracy": 22, "animation": 7, "cli": 26, "compat": 52, "dataset": 6,
    "distributed": 6, "effects": 32, "forks": 1, "inspect": 29, "kernels": 12, "pipeline": 16,
    "runtime": 19, "styles": 2, "survey": 35, "viewer": 60,
}  # fmt: skip
"""How many errors mypy may find in a room, in files of kernels together; in others none. These
numbers only shrink: whoever mends some writes down what is left."""

FRAME = """
import json, sys
import rasterjit as rj
mesh = rj.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
draw = lambda: rj.render(mesh, size=(64, 64), threads=1)
for _ in range(3):
    draw()
calls = []
sys.setprofile(lambda frame, event, _: calls.append(frame.f_code) if event == "call" else None)
draw()
sys.setprofile(None)
ours = [code for code in calls if "rasterjit" in code.co_filename]
print(json.dumps([len(set(ours)), len(ours), len({code.co_filename for code in ours})]))
"""
"""A program that counts the Python functions, calls and files of the package in a warm frame."""

Function = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass
class File:
    """A file of the package."""

    path: str
    """Below the checkout."""
    lines: list[str]
    tree: ast.Module
    nodes: list[ast.AST]

    @property
    def room(self) -> str:
        return self.path.split("/")[1].removesuffix(".py")

    @property
    def module(self) -> str:
        return self.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")

    def functions(self) -> Iterator[tuple[str, ast.FunctionDef]]:
        """Yield the class, or ``''``, and the syntax of every function."""
        classes = [node for node in self.nodes if isinstance(node, ast.ClassDef)]
        owners = {member: node.name for node in classes for member in node.body}
        yield from ((owners.get(n, ""), n) for n in self.nodes if isinstance(n, Function))

    def count_code(self) -> int:
        """Count the lines that hold code: no comments, no docstrings, not blank."""
        found = set()
        for token in tokenize.generate_tokens(io.StringIO("\n".join(self.lines)).readline):
            if token.type not in NO_CODE:
                found |= set(range(token.start[0], token.end[0] + 1))
        for node in filter(is_text, self.nodes):
            found -= set(range(node.lineno, node.end_lineno + 1))
        return len(found)


def read(checkout: Path) -> list[File]:
    """Read all files of the package, stubs too."""
    found = []
    for path in sorted((checkout / "rasterjit").rglob("*.py*")):
        if path.suffix not in {".py", ".pyi"}:
            continue
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        name = path.relative_to(checkout).as_posix()
        found.append(File(name, text.splitlines(), tree, list(ast.walk(tree))))
    return found


def is_text(node: ast.AST) -> bool:
    """Return whether a statement is a docstring, of a module, class, function or constant."""
    value = node.value if isinstance(node, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def is_compiled(node: ast.FunctionDef) -> bool:
    """Return whether a function is compiled."""
    marks = (getattr(mark, "func", mark) for mark in node.decorator_list)
    return not COMPILED.isdisjoint(ast.unparse(mark).rpartition(".")[2] for mark in marks)


def imports(node: ast.AST) -> Iterator[str]:
    """Yield what is imported below a node, in functions too, but not for type checkers alone."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
        elif not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from imports(child)


def circles(files: list[File]) -> list[str]:
    """Return the groups of modules that import each other, directly or by way of others."""
    trees = {file.module: file.tree for file in files}
    graph = {}
    for module, tree in trees.items():
        named = {n if n in trees else n.rpartition(".")[0] for n in imports(tree)}
        graph[module] = (named & trees.keys()) - {module}
    reached = {}
    for module in graph:
        found, waiting = set(), [module]
        while waiting:
            new = graph[waiting.pop()] - found
            found |= new
            waiting += new
        reached[module] = found
    groups = {" - ".join(sorted(o for o in reached[m] if m in reached[o])) for m in graph}
    return sorted(groups - {""})


def long_signatures(files: list[File]) -> list[str]:
    """Return the functions that take too many arguments, keywords of public ones apart."""
    lists = [
        ast.literal_eval(node.value)
        for file in files
        for node in file.tree.body
        if isinstance(node, ast.Assign)
        and ast.unparse(node.targets[0]) == "__all__"
        and isinstance(node.value, ast.List)
    ]
    public, found = {name for names in lists for name in names}, []
    for file in files:
        for owner, node in file.functions():
            taken = [*node.args.posonlyargs, *node.args.args]
            if file.path not in PUBLIC_FILES and public.isdisjoint((owner, node.name)):
                taken += node.args.kwonlyargs
            is_ours = not OF_OTHERS.search(file.path)
            if len(taken) > MAX_PARAMETERS and not is_compiled(node) and is_ours:
                found.append(f"{file.path}: {node.name} takes {len(taken)}")
    return found


def repeated_classes(files: list[File]) -> list[str]:
    """Return the class names that several files define, and where."""
    places = defaultdict(set)
    for file in files:
        for node in file.nodes if not OF_OTHERS.search(file.path) else ():
            if isinstance(node, ast.ClassDef):
                places[node.name].add(file.module.removeprefix("rasterjit."))
    return [f"{name}: {', '.join(sorted(p))}" for name, p in sorted(places.items()) if len(p) > 1]


def headings(files: list[File]) -> dict[str, bool]:
    """Return the long functions, and whether a comment on a line of its own heads a step."""
    found = {}
    for file in files:
        for _, node in file.functions():
            body = node.body[1:] if is_text(node.body[0]) else node.body
            if body and node.end_lineno - body[0].lineno >= MAX_LINES_WITHOUT_HEADING:
                start = node.body[0].end_lineno if is_text(node.body[0]) else node.lineno
                lines = file.lines[start : node.end_lineno]
                heads = any(line.lstrip().startswith("#") for line in lines)
                found[f"{file.path}:{node.lineno}: {node.name}"] = heads
    return found


def members_of_effect(files: list[File]) -> str:
    """Return how many attributes and methods the class `Effect` has."""
    for node in (node for file in files for node in file.nodes):
        if isinstance(node, ast.ClassDef) and node.name == "Effect":
            kinds = Counter(type(member) for member in node.body)
            return f"{kinds[ast.AnnAssign] + kinds[ast.Assign]}, {kinds[ast.FunctionDef]}"
    return ""


def type_errors(checkout: Path, files: list[File]) -> dict[str, list[str]]:
    """Return the errors that mypy finds in each room, those in files of kernels together."""
    rooms = {
        file.path: "kernels" if any(is_compiled(n) for _, n in file.functions()) else file.room
        for file in files
    }
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "rasterjit", "--cache-dir", os.devnull], cwd=checkout,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1) or done.stderr:
        raise click.ClickException(f"mypy failed: {done.stdout}{done.stderr}")
    found = defaultdict(list)
    for line, path in re.findall(r"^((\S+?):\d+: error:.*)$", done.stdout, re.MULTILINE):
        found[rooms.get(path, path)].append(line)
    return found


def beyond(errors: dict[str, list[str]]) -> list[str]:
    """Return the errors of the rooms that have more than they may, below a line for each."""
    found = []
    for room, lines in sorted(errors.items()):
        most = MAX_TYPE_ERRORS.get(room, 0)
        if len(lines) > most:
            found += [f"{room}: {len(lines)} errors of mypy, at most {most} are allowed", *lines]
    return found


def work_of_a_frame(checkout: Path) -> str:
    """Return the Python functions, calls and files of a warm frame of one triangle."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FRAME], cwd=checkout, capture_output=True,
        text=True, env=package_environment({}, checkout), check=True,
    )  # fmt: skip
    return ", ".join(map(str, json.loads(done.stdout)))


def count_lines(*paths: Path) -> int:
    """Count all lines of text files."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def measure(checkout: Path, quick: bool) -> tuple[dict[str, object], dict[str, list[str]]]:
    """Return the rows of a checkout, and what is behind those that shall be 0."""
    files = read(checkout)
    code = Counter()
    for file in files:
        code[file.room] += file.count_code()
    heads = headings(files)
    named = {
        "circles of imports": circles(files),
        f"functions with more than {MAX_PARAMETERS} parameters": long_signatures(files),
        "class names with two meanings": repeated_classes(files),
        f"functions above {MAX_LINES_WITHOUT_HEADING} lines without a heading": [
            name for name, heads_a_step in heads.items() if not heads_a_step
        ],
    }
    rows = {"lines of code": code.total(), **{f"  of {room}": n for room, n in code.items()}}
    rows["files"] = len(files)
    rows |= {f"  in {room}": n for room, n in Counter(f.room for f in files).items() if n > 1}
    rows |= {name: len(found) for name, found in named.items()}
    rows[f"functions above {MAX_LINES_WITHOUT_HEADING} lines"] = len(heads)
    rows["attributes, methods of Effect"] = members_of_effect(files)
    rows["lines of tests"] = count_lines(*(checkout / "tests").rglob("*.py"))
    rows["lines of CHANGELOG.md"] = count_lines(checkout / "CHANGELOG.md")
    if not quick:
        rows["functions, calls, files of a warm frame"] = work_of_a_frame(checkout)
        errors = {room: len(lines) for room, lines in sorted(type_errors(checkout, files).items())}
        rows["errors of mypy"] = sum(errors.values())
        rows |= {f"  mypy, {room}": n for room, n in errors.items()}
    return rows, named


@click.command()
@click.option("--against", help="Commit to measure as well.")
@click.option("--quick", is_flag=True, help="Read the source alone: no frame, no mypy.")
@click.option("--names", is_flag=True, help="List what is counted and shall not be there.")
@click.option("--types", is_flag=True, help="Fail if mypy finds more in a room than it may.")
def main(against: str | None, quick: bool, names: bool, types: bool) -> None:
    """Measure the source of the package."""
    console = Console()
    if types:
        here = Path(__file__).parents[1]
        errors = type_errors(here, read(here))
        counts = ", ".join(f"{room} {len(lines)}" for room, lines in sorted(errors.items()))
        console.print(f"errors of mypy: {counts or 'none'}", soft_wrap=True)
        if found := beyond(errors):
            raise click.ClickException("\n".join(found))
        return
    with tempfile.TemporaryDirectory(prefix="rasterjit-") as place:
        try:
            with checkouts([*filter(None, [against]), "."], Path(place)) as trees:
                measured = {name: measure(folder, quick) for name, folder in trees}
        except RevisionError as error:
            raise click.ClickException(str(error)) from error
    table = Table("what", title="the source of the package")
    for name in measured:
        table.add_column(name, justify="right")
    for row in dict.fromkeys(row for rows, _ in measured.values() for row in rows):
        table.add_row(row, *(str(rows.get(row, 0)) for rows, _ in measured.values()))
    console.print(table)
    for title, found in list(measured.values())[-1][1].items() if names else ():
        console.print("\n".join([f"\n{title}:", *found]), soft_wrap=True, markup=False)


if __name__ == "__main__":
    main()
