"""Two versions of the repository side by side, in folders of their own."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.pairing import ROOT

WORKING_TREE = (".", "WORKTREE")
"""What names the files as they are, committed or not."""


class RevisionError(ValueError):
    """A commit that git does not know."""


def git(*arguments: str, root: Path = ROOT) -> str:
    """Run git in the repository and return what it prints."""
    result = subprocess.run(
        ["git", *arguments], cwd=root, capture_output=True, text=True, check=False
    )
    if result.returncode != 0:
        raise RevisionError(result.stderr.strip() or f"git {arguments[0]} failed")
    return result.stdout.strip()


@contextlib.contextmanager
def checkouts(
    revisions: Sequence[str], folder: Path, root: Path = ROOT
) -> Iterator[list[tuple[str, Path]]]:
    """
    Check commits out below a folder, and remove them in any case.

    Yields the short hash and the folder of each; ``"."`` and ``"WORKTREE"`` are the repository's
    own folder.

    Raises
    ------
    RevisionError
        If a revision is no commit.
    """
    with contextlib.ExitStack() as stack:
        found = []
        for number, revision in enumerate(revisions):
            if revision in WORKING_TREE:
                found.append(("working tree", root))
                continue
            name = f"{revision}^{{commit}}"
            try:
                commit = git("rev-parse", "--verify", "--end-of-options", name, root=root)
            except RevisionError as error:
                raise RevisionError(f"{revision!r} is not a commit: {error}") from error
            place = folder / f"checkout-{number}"
            stack.callback(remove, place, root)
            git("worktree", "add", "--detach", str(place), commit, root=root)
            found.append((commit[:10], place))
        yield found


def remove(place: Path, root: Path) -> None:
    """Remove a worktree, also one that was never finished."""
    with contextlib.suppress(RevisionError):
        git("worktree", "remove", "--force", str(place), root=root)
    git("worktree", "prune", root=root)
