"""The store holds what was compiled, whatever happens to it and to those who write it."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import small_kernels
from small import RESULTS, entries, start, use

from rasterjit.runtime import jit, store
from rasterjit.runtime import pack_arguments as pack_arguments  # Arguments are packed by it.
from rasterjit.runtime.state_block import RecordType, infer_type

pytestmark = [
    pytest.mark.takes_long,
    pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="nothing is kept"),
]
as_root = pytest.mark.skipif(
    getattr(os, "geteuid", lambda: -1)() != 0, reason="makes files of other users"
)
posix_only = pytest.mark.skipif(os.name != "posix", reason="modes and locks of POSIX")

ROW = np.arange(-3.0, 5.0)
KIND = RecordType(tuple, (infer_type(ROW), infer_type(5)))
"""The types of the arguments of ``has_index``."""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty store, for this process."""
    # What packs arguments is a kernel, too, and lies elsewhere.
    jit.get_packer()
    tmp_path.chmod(0o700)
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(store, "PRINTED_SUBJECTS", set())
    return tmp_path


def load():
    """Bring a kernel into memory, see that it works; return whether it came from the store."""
    code = store.load(small_kernels.has_index, KIND)
    form = jit.Form(KIND, code)
    for n in (1, 5):
        assert form.run(form.pack((ROW, n))) == (ROW[n] > 0.0)
    return code.is_loaded


def entry(place):
    """Return the only entry."""
    (path,) = place.glob("*.kernel")
    return path


def test_what_was_compiled_is_loaded(place):
    assert [load(), load()] == [False, True]
    assert [path.suffix for path in place.iterdir()] == [".kernel"]


DAMAGES = {
    "empty": lambda content: b"",
    "cut": lambda content: content[:-100],
    "cut in its checksum": lambda content: content[: len(store.MAGIC) + 9],
    "zeroed": lambda content: bytes(len(content)),
    "zeroed at its end": lambda content: content[:-64] + bytes(64),
    "other format": lambda content: content.replace(b"kernel 2", b"kernel 1", 1),
    "longer": lambda content: content + b"\0",
    **{
        f"bit {bit} of byte {byte}": lambda content, byte=byte, bit=bit: (
            content[:byte] + bytes([content[byte] ^ 1 << bit]) + content[byte + 1 :]
        )
        for byte, bit in ((0, 0), (25, 3), (60, 7), (200, 1), (-9, 4))
        if byte >= 0
    },
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_found_told_once_and_mended_by_compiling(place, damage, capfd):
    load()
    path = entry(place)
    content = path.read_bytes()
    path.write_bytes(DAMAGES[damage](content))
    assert capfd.readouterr().err == ""
    assert not load()
    assert path.read_bytes() == content
    assert load()
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("rasterjit: compiling again")
    assert str(place) in line
    assert path.name in line


@pytest.mark.parametrize(
    "other",
    [
        {"versions": "0.1 0.1"}, {"cpu": "another"}, {"triple": "another"}, {"types": "(int64)"},
        {"kernel": "small_kernels.another"}, {"sources": "0" * 32},
    ],
    ids=lambda other: next(iter(other)),
)  # fmt: skip
def test_an_entry_made_for_something_else_is_compiled_again(place, capfd, other):
    load()
    path = entry(place)
    header, code = store.read_entry(path)
    store.write_entry(path, header._replace(**other), code)
    assert not load()
    assert store.read_entry(path) == (header, code)
    (line,) = capfd.readouterr().err.splitlines()
    assert "made for another" in line


def test_swapped_files_are_damaged(place):
    load()
    mine = entry(place)
    small_row = np.zeros(3, np.float32)
    other_kind = RecordType(tuple, (infer_type(small_row), infer_type(1)))
    store.load(small_kernels.has_index, other_kind)
    (other,) = set(place.glob("*.kernel")) - {mine}
    contents = mine.read_bytes(), other.read_bytes()
    mine.write_bytes(contents[1])
    other.write_bytes(contents[0])
    assert len(store.inspect_folder(place).damaged) == 2
    assert not load()
    assert mine.read_bytes() == contents[0]


def test_what_ends_the_process_when_it_is_linked_is_not_stored(place, monkeypatch):
    def end(*given):
        raise SystemExit

    monkeypatch.setattr(store, "_link", end)
    with pytest.raises(SystemExit):
        load()
    assert not [*place.glob("*.kernel")]


WAITS_WHILE_LINKING = """
link = store._link
def wait_and_link(*given):
    print("linking", flush=True)
    sys.stdin.readline()
    return link(*given)
store._link = wait_and_link
"""


def start_linking(place):
    """Start a process that links the entry of a store when told to, and wait until it is there."""
    process = start(place, before=WAITS_WHILE_LINKING)
    assert process.stdout.readline() == "linking\n"
    return process


def test_an_entry_that_ended_the_process_that_linked_it_is_compiled_again(place):
    use(place)
    content = entry(place).read_bytes()
    killed = start_linking(place)
    killed.kill()
    killed.communicate()
    found, compiled, _, said = use(place)
    assert (found, compiled) == ([RESULTS["has_index"]], ["has_index"])
    (line,) = said.splitlines()
    assert line.endswith(f"{entry(place).name} was being linked when a process ended")
    # It is no worse than another.
    assert entry(place).read_bytes() == content
    assert use(place)[1:] == ([], False, "")
    assert [path.suffix for path in place.iterdir()] == [".kernel"]


def test_an_entry_that_another_process_links_is_linked_too(place):
    use(place)
    first = start_linking(place)
    second = start_linking(place)
    assert use(place)[1:] == ([], False, "")
    for process in (second, first):
        out, said = process.communicate("\n")
        assert out.endswith(", [], false]\n")
        assert said == ""
        assert use(place)[1:] == ([], False, "")
    assert [path.suffix for path in place.iterdir()] == [".kernel"]


def test_without_numba_an_entry_that_ended_a_process_is_tried_again(place):
    use(place)
    killed = start_linking(place)
    killed.kill()
    killed.communicate()
    assert use(place, before="store.compiler_versions = lambda: None")[1:] == ([], False, "")
    assert [path.suffix for path in place.iterdir()] == [".kernel"]


def test_an_error_while_an_entry_is_linked_leaves_no_mark(place, monkeypatch):
    load()

    def fail(*given):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(store, "_link", fail)
        with pytest.raises(KeyboardInterrupt):
            load()
    assert load()


def test_object_code_that_cannot_be_linked_is_compiled_again(place):
    load()
    path = entry(place)
    header, code = store.read_entry(path)
    store.write_entry(path, header, code[:64])
    assert not load()
    assert store.read_entry(path) == (header, code)


def test_a_folder_in_place_of_a_file_is_replaced(place, capfd):
    load()
    path = entry(place)
    content = path.read_bytes()
    path.unlink()
    (path / "inside").mkdir(parents=True)
    assert [load(), load()] == [False, True]
    assert path.read_bytes() == content
    (line,) = capfd.readouterr().err.splitlines()
    assert "is a folder" in line


def as_pipe(path):
    os.mkfifo(path)


def as_endless_device(path):
    path.symlink_to("/dev/zero")


def as_link(path):
    path.symlink_to(Path(__file__))


def as_huge_file(path):
    path.touch()
    os.truncate(path, 1 << 40)


@pytest.mark.skipif(sys.platform == "win32", reason="no pipes among files, links only for some")
@pytest.mark.parametrize("make", [as_pipe, as_endless_device, as_link, as_huge_file])
def test_what_is_no_entry_at_all_is_never_read(place, capfd, make):
    load()
    path = entry(place)
    content = path.read_bytes()
    path.unlink()
    make(path)
    assert store.inspect_folder(place).damaged == [path]
    assert [load(), load()] == [False, True]
    assert path.read_bytes() == content
    assert not path.is_symlink()
    (line,) = capfd.readouterr().err.splitlines()
    assert "is no regular file" in line or "more than any entry" in line


def test_a_folder_in_place_of_a_file_is_mended(place):
    load()
    path = entry(place)
    path.unlink()
    (path / "inside").mkdir(parents=True)
    found = store.inspect_folder(place)
    assert (found.entries, found.damaged) == (0, [path])
    assert store.remove_damaged(found) == []
    assert not path.exists()


def test_a_file_that_cannot_be_read_is_compiled_around_and_told(place, monkeypatch):
    load()
    path = entry(place)
    opened = os.open

    def refuse(file, *arguments):
        if file == path:
            raise PermissionError(errno.EACCES, "not yours")
        return opened(file, *arguments)

    monkeypatch.setattr(os, "open", refuse)
    assert not load()
    assert store.inspect_folder(place).unreadable == [path]


def test_a_full_disk_keeps_nothing_leaves_nothing_and_is_told_once(place, monkeypatch, capfd):
    fdopen = os.fdopen

    def full(number, mode):
        file = fdopen(number, mode)
        write = file.write

        class Full:
            def __enter__(self):
                return self

            def __exit__(self, *error):
                file.close()

            def write(self, content):
                write(content[:100])
                raise OSError(errno.ENOSPC, "no space left on device")

        return Full()

    monkeypatch.setattr(store.os, "fdopen", full)
    assert [load(), load()] == [False, False]
    assert list(place.iterdir()) == []
    (line,) = capfd.readouterr().err.splitlines()
    assert line == (
        f"rasterjit: compiled kernels are not kept on disk: {place}: no space left on device"
    )


def refuse_new_files(monkeypatch, error):
    """Let no entry be begun; return a list that gets the path of each that somebody tries to."""
    tried, begin = [], os.open

    def refuse(path, *arguments, **options):
        if not str(path).endswith(store.PART):
            return begin(path, *arguments, **options)
        tried.append(path)
        raise error

    monkeypatch.setattr(os, "open", refuse)
    return tried


def test_a_folder_that_cannot_be_written_is_read_and_told_once(place, monkeypatch, capfd):
    load()
    kept = entry(place)

    refuse_new_files(monkeypatch, OSError(errno.EROFS, "read-only file system"))
    assert load()
    assert capfd.readouterr().err == ""
    kept.unlink()
    assert [load(), load()] == [False, False]
    assert list(place.iterdir()) == []
    assert capfd.readouterr().err.count("read-only file system\n") == 1


def test_a_folder_that_windows_lets_nobody_write_to_is_tried_once(place, monkeypatch, capfd):
    """There `os.access` says that one may, so that `tempfile` tries one name after the other."""
    tried = refuse_new_files(monkeypatch, PermissionError(errno.EACCES, "access is denied"))
    monkeypatch.setattr(tempfile, "_os", SimpleNamespace(**{**vars(os), "name": "nt"}))
    monkeypatch.setattr(tempfile, "TMP_MAX", 100)
    assert not load()
    assert len(tried) == 1
    assert capfd.readouterr().err.endswith(f"not kept on disk: {place}: access is denied\n")


@pytest.mark.parametrize("refusals", [3, 4])
def test_a_file_that_is_in_use_for_a_moment_is_waited_for(place, monkeypatch, capfd, refusals):
    """Windows neither reads nor replaces what another process has open."""
    monkeypatch.setattr(store, "RETRY_PAUSES", (0.0, 0.0, 0.0))
    replace, opened, left = os.replace, os.open, []

    def refuse_often(action, *arguments):
        if not left:
            return action(*arguments)
        left.pop()
        raise PermissionError(errno.EACCES, "in use")

    monkeypatch.setattr(store.os, "replace", lambda *paths: refuse_often(replace, *paths))
    header, path = store.Header(next(iter(store.RETURNS)), *"bcdefg"), place / "a.kernel"
    left[:] = [1] * refusals
    store.write_entry(path, header, b"code")
    is_told = refusals > 3
    assert path.exists() != is_told
    assert capfd.readouterr().err.count("not kept on disk") == is_told
    assert [one.suffix for one in place.iterdir()] == [] if is_told else [".kernel"]
    left.clear()
    store.write_entry(path, header, b"code")
    monkeypatch.setattr(store.os, "open", lambda *options: refuse_often(opened, *options))
    left[:] = [1] * refusals
    assert store.read_entry(path) == (None if is_told else (header, b"code"))
    assert capfd.readouterr().err.count("cannot be used") == is_told


def test_a_folder_that_cannot_be_made_is_told(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(store, "PRINTED_SUBJECTS", set())
    (tmp_path / "file").touch()
    monkeypatch.setenv(store.FOLDER_VARIABLE, str(tmp_path / "file" / "kernels"))
    assert store.kernel_folder.__wrapped__() is None
    (line,) = capfd.readouterr().err.splitlines()
    assert str(tmp_path / "file") in line
    assert "not kept on disk" in line


def test_a_home_that_nobody_knows_keeps_nothing(monkeypatch, capfd):
    monkeypatch.setattr(store, "PRINTED_SUBJECTS", set())

    def unknown():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv(store.FOLDER_VARIABLE, raising=False)
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", unknown)
    assert store.kernel_folder.__wrapped__() is None
    (line,) = capfd.readouterr().err.splitlines()
    assert store.FOLDER_VARIABLE in line


def test_the_folder_is_the_users_alone(monkeypatch, tmp_path):
    monkeypatch.delenv(store.FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(store, "user_cache_folder", lambda: tmp_path / ".cache" / "rasterjit")
    before = os.umask(0o002)
    try:
        made = store.kernel_folder.__wrapped__()
    finally:
        os.umask(before)
    assert made == tmp_path / ".cache" / "rasterjit" / "kernels"
    assert made.stat().st_mode & 0o777 == 0o700 or os.name != "posix"


@posix_only
def test_a_folder_of_another_user_is_refused(tmp_path, monkeypatch):
    owner = tmp_path.stat().st_uid
    monkeypatch.setenv(store.FOLDER_VARIABLE, str(tmp_path))
    tmp_path.chmod(0o700)
    monkeypatch.setattr(store.os, "geteuid", lambda: owner + 1)
    # Root may write to any folder, so its own are not refused.
    monkeypatch.setattr(store, "ROOT_USER", -1)
    with pytest.warns(RuntimeWarning, match="others may write to it"):
        assert store.kernel_folder.__wrapped__() is None


@posix_only
@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {}, ".cache"),
        ("linux", {"XDG_CACHE_HOME": "/home/someone/elsewhere"}, "elsewhere"),
        ("linux", {"XDG_CACHE_HOME": "elsewhere"}, ".cache"),
        ("darwin", {}, "Library/Caches"),
        ("win32", {"LOCALAPPDATA": "/home/someone/Local"}, "Local"),
    ],
)
def test_the_folder_is_where_the_platform_keeps_caches(monkeypatch, platform, variables, expected):
    home = Path("/home/someone")
    monkeypatch.setattr(Path, "home", lambda: home)
    monkeypatch.setattr(store.sys, "platform", platform)
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert store.user_cache_folder() == home / expected / "rasterjit"


@posix_only
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o703])
def test_a_folder_that_others_may_write_to_is_refused_with_one_warning(tmp_path, mode):
    tmp_path.chmod(mode)
    found, compiled, _, said = use(tmp_path, ("has_index", "draw_line"))
    assert found[0] == RESULTS["has_index"]
    assert {"has_index", "draw_line"} <= {*compiled}
    assert said.count("RuntimeWarning") == said.count("others may write to it") == 1
    assert list(tmp_path.iterdir()) == []


@posix_only
@pytest.mark.parametrize("mode", [0o755, 0o777, 0o775, 0o757, 0o1777])
def test_a_folder_below_one_that_others_may_write_to_is_refused(tmp_path, monkeypatch, mode):
    below = tmp_path / "parent" / "between" / "kernels"
    below.mkdir(parents=True, mode=0o700)
    below.chmod(0o700)
    below.parent.chmod(0o755)
    (tmp_path / "parent").chmod(mode)
    link = tmp_path / "link"
    link.symlink_to(below.parent)
    for chosen in (below, link / "kernels"):
        monkeypatch.setenv(store.FOLDER_VARIABLE, str(chosen))
        if mode in (0o755, 0o1777):
            assert store.kernel_folder.__wrapped__() == below
        else:
            with pytest.warns(RuntimeWarning, match=r"others may write to .*parent, and exchange"):
                assert store.kernel_folder.__wrapped__() is None


AS_USER = """
import os, sys, warnings
from pathlib import Path
from rasterjit.runtime import store
warnings.simplefilter("ignore")
os.seteuid(int(sys.argv[1]))
for one in map(Path, sys.argv[2:]):
    if one.suffix:
        print(store.read_entry(one) is not None)
    else:
        os.environ[store.FOLDER_VARIABLE] = str(one)
        print(store.kernel_folder.__wrapped__() is not None)
"""
"""Tells of folders and entries whether another user uses them."""

USER, OTHER = 65534, 65533


def used_by_user(places):
    """Return of each folder and entry whether `USER` uses it."""
    command = [sys.executable, "-c", AS_USER, str(USER), *map(str, places)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return [one == "True" for one in said.split()]


@pytest.fixture
def top():
    """A folder that every user reaches."""
    with tempfile.TemporaryDirectory() as top:
        os.chmod(top, 0o755)
        yield Path(top)


@as_root
def test_each_folder_above_belongs_to_the_user_or_root(top):
    cases = {
        (USER, 0o755): True, (USER, 0o1777): True, (USER, 0o777): False,
        (0, 0o755): True, (0, 0o1777): True, (0, 0o777): False,
        (OTHER, 0o755): False, (OTHER, 0o1777): False,
    }  # fmt: skip
    places = []
    for between in ("", "between"):
        for owner, mode in cases:
            parent = top / f"{owner} {mode:o}{between}"
            places.append(parent / between / "kernels")
            places[-1].mkdir(parents=True)
            for one in (places[-1], *[parent / between] * bool(between)):
                one.chmod(0o700)
                os.chown(one, USER, -1)
            os.chown(parent, owner, -1)
            parent.chmod(mode)
    assert used_by_user(places) == [*cases.values()] * 2


@as_root
def test_the_folder_belongs_to_the_user_or_root_and_nobody_else_writes_to_it(top):
    cases = {
        (USER, 0o700): True, (USER, 0o755): True, (0, 0o755): True,
        (OTHER, 0o755): False, (OTHER, 0o700): False, (OTHER, 0o1755): False,
        # That it is sticky keeps nobody from adding to it.
        (USER, 0o1777): False, (USER, 0o720): False, (USER, 0o702): False, (USER, 0o2775): False,
        (0, 0o775): False, (0, 0o757): False, (0, 0o1777): False,
    }  # fmt: skip
    places = []
    for owner, mode in cases:
        places.append(top / f"{owner} {mode:o}")
        places[-1].mkdir()
        os.chown(places[-1], owner, -1)
        places[-1].chmod(mode)
    # A link is as good as where it leads, whosever it is.
    links = [one.with_name(f"link to {one.name}") for one in places]
    for link, one in zip(links, places, strict=True):
        link.symlink_to(one)
        os.lchown(link, OTHER, -1)
    assert used_by_user([*places, *links]) == [*cases.values()] * 2


@as_root
def test_each_entry_belongs_to_the_user_or_root_under_one_name(top):
    cases = {
        (USER, 0o600): True, (USER, 0o444): True, (0, 0o644): True,
        (OTHER, 0o644): False, (OTHER, 0o444): False,
        (USER, 0o620): False, (USER, 0o602): False, (USER, 0o666): False,
        (0, 0o664): False, (0, 0o646): False,
    }  # fmt: skip
    places = []
    for owner, mode in cases:
        places.append(top / f"{owner} {mode:o}.kernel")
        store.write_entry(places[-1], ENTRY, b"code")
        os.chown(places[-1], owner, -1)
        places[-1].chmod(mode)
    for name, make in (("link", os.symlink), ("hard", os.link)):
        places.append(top / f"{name}.kernel")
        store.write_entry(places[-1], ENTRY, b"code")
        places[-1].chmod(0o644)
        make(places[-1].rename(top / name), places[-1])
    assert used_by_user(places) == [*cases.values(), False, False]


@pytest.fixture
def bare(tmp_path, monkeypatch):
    """An empty store of which nothing was told yet; no kernel is made."""
    monkeypatch.setattr(store, "PRINTED_SUBJECTS", set())
    return tmp_path


ENTRY = store.Header("none", "a.b", "(int)", "0", "1 2", "triple", "cpu")


@posix_only
@pytest.mark.parametrize("change", [
    lambda path: path.chmod(0o620), lambda path: path.chmod(0o602),
    lambda path: os.link(path, path.with_name("other")),
    lambda path: path.symlink_to(path.rename(path.with_name("other"))),
    pytest.param(lambda path: os.chown(path, OTHER, -1), marks=as_root),
], ids=["group", "others", "hard link", "link", "owner"])  # fmt: skip
def test_an_entry_that_others_may_change_is_told_once_and_written_again(bare, capfd, change):
    path = bare / "name.kernel"
    store.write_entry(path, ENTRY, b"code")
    assert store.read_entry(path) == (ENTRY, b"code")
    change(path)
    assert store.read_entry(path) is store.read_entry(path) is None
    (line,) = capfd.readouterr().err.splitlines()
    assert path.name in line
    assert store.inspect_folder(bare).damaged == [path]
    store.write_entry(path, ENTRY, b"code")
    assert store.read_entry(path) == (ENTRY, b"code")


@posix_only
def test_what_is_opened_is_checked_and_not_what_stood_there_before(bare, monkeypatch):
    path = bare / "name.kernel"
    store.write_entry(path, ENTRY, b"code")
    innocent = path.lstat()
    path.chmod(0o666)
    monkeypatch.setattr(Path, "lstat", lambda _: innocent)
    assert store.read_entry(path) is None


@pytest.mark.parametrize("line", [
    b"", b"\xff\xfe", b"none\tkernel", b"\t".join([b"none"] * 8), b"words" + b"\t" * 6,
])  # fmt: skip
def test_a_header_of_other_text_is_damage_whatever_its_checksum(bare, capfd, line):
    path = bare / "name.kernel"
    rest = line + b"\ncode"
    path.write_bytes(store.MAGIC + store._checksum(path.name, rest) + rest)
    path.chmod(0o600)
    assert store.read_entry(path) is None
    assert "is damaged" in capfd.readouterr().err
    assert store.inspect_folder(bare).damaged == [path]


def test_processes_that_begin_together_compile_once(tmp_path):
    tmp_path.chmod(0o700)
    others = [start(tmp_path) for _ in range(3)]
    outs = [one.communicate()[0] for one in others]
    assert [one.returncode for one in others] == [0, 0, 0]
    assert sum(out.count('"has_index"') for out in outs) == 1
    assert {path.suffix for path in tmp_path.iterdir()} == {".kernel"}


DIES_WRITING = "import os; os.replace = lambda *paths: os.kill(os.getpid(), 9)"

SLEEPS = """
from rasterjit.runtime import compiler
def sleep(*arguments):
    import time
    print("compiling", flush=True)
    time.sleep(60)
compiler.compile_form = sleep
"""


@posix_only
def test_a_process_that_is_killed_as_it_writes_leaves_what_the_next_can_do_without(place):
    killed = start(place, before=DIES_WRITING)
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    suffixes = sorted(path.suffix for path in place.iterdir())
    assert suffixes == [".lock", ".part"]
    assert use(place)[0] == [RESULTS["has_index"]]
    found = store.inspect_folder(place)
    assert [path.suffix for path in found.temporary] == [".part"]
    # It might still be written.
    assert store.remove_damaged(found) == []
    assert found.temporary[0].exists()
    long_ago = time.time() - 2.0 * store.MAX_TEMPORARY_AGE
    os.utime(found.temporary[0], (long_ago, long_ago))
    assert store.remove_damaged(found) == []
    assert not found.temporary[0].exists()
    assert store.inspect_folder(place).entries > 0


@posix_only
def test_what_killed_processes_left_long_ago_goes_with_the_next_that_compiles(place):
    left = place / ".abc.part"
    left.touch()
    fresh = place / ".def.part"
    fresh.touch()
    long_ago = time.time() - 2.0 * store.MAX_TEMPORARY_AGE
    os.utime(left, (long_ago, long_ago))
    load()
    assert not left.exists()
    assert fresh.exists()


@posix_only
def test_nobody_waits_for_a_process_that_was_killed_as_it_compiled(place):
    killed = start(place, before=SLEEPS)
    assert killed.stdout.readline() == "compiling\n"
    (claim,) = place.glob("*.lock")
    found = store.inspect_folder(place)
    # Not while it lives.
    assert store.remove_damaged(found) == []
    assert claim.exists()
    killed.kill()
    killed.communicate()
    began = time.monotonic()
    assert use(place)[0] == [RESULTS["has_index"]]
    assert time.monotonic() - began < 0.8 * store.LOCK_PATIENCE
    assert store.remove_damaged(store.inspect_folder(place)) == []
    assert list(place.glob("*.lock")) == []


def test_bytes_do_not_depend_on_the_order_of_compiling(tmp_path):
    orders = [("draw_line", "add_lines", "has_index"), ("has_index", "add_lines", "draw_line")]
    files = []
    for number, names in enumerate(orders):
        place = tmp_path / str(number)
        place.mkdir(mode=0o700)
        results, compiled, has_numba, _ = use(place, names)
        assert has_numba
        assert [name for name in compiled if name in names] == list(names)
        if names[0] == "draw_line":
            assert results[:2] == [RESULTS[name] for name in names[:2]]
        files.append({path.name: path.read_bytes() for path in place.iterdir()})
    assert files[0] == files[1]
    # All in one process, from files of both.
    mixed = tmp_path / "mixed"
    mixed.mkdir(mode=0o700)
    for n, name in enumerate(sorted(files[0])):
        (mixed / name).write_bytes(files[n % 2][name])
    results, compiled, has_numba, _ = use(mixed, orders[0])
    assert (compiled, has_numba) == ([], False)
    assert results[:2] == [RESULTS[name] for name in orders[0][:2]]


SETTINGS = """
disable_jit: 1
boundscheck: 1
cache_dir: {folder}
debug: 1
dump_llvm: 1
opt: 0
"""
"""What Numba would read in the current folder."""


def test_the_current_folder_has_no_say_in_compiling(tmp_path, monkeypatch):
    for name in ("clean", "own"):
        (tmp_path / name).mkdir(mode=0o700)
    bare = tmp_path / "bare"
    bare.mkdir()
    monkeypatch.chdir(bare)
    expected = use(tmp_path / "clean", ("draw_line", "has_index"))
    planted = tmp_path / "planted"
    planted.mkdir()
    text = SETTINGS.format(folder=planted / "cache")
    (planted / ".numba_config.yaml").write_text(text)
    monkeypatch.chdir(planted)
    found = use(tmp_path / "own", ("draw_line", "has_index"))
    assert found == expected
    assert found[2]
    assert [path.name for path in planted.iterdir()] == [".numba_config.yaml"]
    kept, clean = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
        for name in ("own", "clean")
    )
    assert kept == clean


def test_settings_that_are_no_yaml_are_not_read(tmp_path, monkeypatch):
    tmp_path.chmod(0o700)
    (tmp_path / ".numba_config.yaml").write_text("{[")
    monkeypatch.chdir(tmp_path)
    assert use(tmp_path)[0] == [RESULTS["has_index"]]


def test_numba_reads_environment_variables_yet(tmp_path):
    tmp_path.chmod(0o700)
    after = (
        "import atexit; atexit.register(lambda: print(sys.modules['numba'].config.SHOW_HELP, "
        "file=sys.stderr))"
    )
    assert use(tmp_path, before=after, NUMBA_SHOW_HELP="1")[3] == "1\n"


WITHOUT_NUMBA = "sys.modules['numba'] = None"


def test_without_numba_any_versions_entries_are_loaded(tmp_path):
    tmp_path.chmod(0o700)
    use(tmp_path)
    for path in entries(tmp_path).values():
        header, code = store.read_entry(path)
        other = path.with_name(f"{path.name.split('.')[0]}.01234567.kernel")
        store.write_entry(other, header._replace(versions="0.1 0.1"), code)
        path.unlink()
    found, compiled, *_ = use(tmp_path, before=WITHOUT_NUMBA)
    assert (found, compiled) == ([RESULTS["has_index"]], [])
    assert store.inspect_folder(tmp_path).other_versions == len(entries(tmp_path))


def test_versions_are_known_without_importing_numba():
    import llvmlite
    import numba

    assert store.compiler_versions() == f"{numba.__version__} {llvmlite.__version__}"


def test_records_of_one_name_are_told_apart():
    from typing import NamedTuple

    class Line(NamedTuple):
        slope: float
        other: float

    kinds = [RecordType(one, (infer_type(1.0),) * 2) for one in (Line, small_kernels.Line, tuple)]
    assert len({store.describe_type(kind) for kind in kinds}) == 3


def test_the_cpu_is_in_the_name():
    target = store.Target("x86_64-unknown-linux-gnu", "x86-64-v2", "")
    targets = [
        target, target._replace(cpu="x86-64-v3"), target._replace(features="+avx"),
        target._replace(triple="aarch64-unknown-linux-gnu"),
    ]  # fmt: skip
    assert len({store.symbol_name(small_kernels.has_index, KIND, one) for one in targets}) == 4


def test_contents_are_counted(place, monkeypatch):
    load()
    path = entry(place)
    header, code = store.read_entry(path)
    others = {
        "versions": "0.1 0.1", "cpu": "another", "triple": "another", "sources": "0" * 32,
    }  # fmt: skip
    for n, (field, value) in enumerate(others.items()):
        store.write_entry(
            path.with_name(f"x_{n}.0.kernel"), header._replace(**{field: value}), code
        )
    found = store.inspect_folder(place)
    assert found[:4] == (5, 1, 2, 1)
    assert found.size == sum(one.stat().st_size for one in place.iterdir())
    assert found[5:] == ([], [], [])
    # What has no compiler has made them of LLVM's text.
    monkeypatch.setattr(store, "compiler_versions", lambda: None)
    assert store.inspect_folder(place).other_versions == 0


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks")
def test_a_file_system_without_locks_makes_nobody_wait(place, monkeypatch):
    import fcntl

    def refuse(*arguments):
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    began = time.monotonic()
    assert not load()
    assert time.monotonic() - began < 0.5 * store.LOCK_PATIENCE


@posix_only
@pytest.mark.parametrize("is_there", [True, False])
def test_a_claim_is_one_process_s_and_needs_a_folder(tmp_path, monkeypatch, is_there):
    monkeypatch.setattr(store, "LOCK_PATIENCE", 0.1)
    path = tmp_path / "store" / f"a{store.SUFFIX}"
    if is_there:
        path.parent.mkdir()
    began = time.monotonic()
    with store.lock_entry(path):
        claims = store.list_temporary_files(path.parent)
        assert len(claims) == is_there
        assert [store._is_in_use(one) for one in claims] == [True] * is_there
        with store.lock_entry(path):
            # The claim of who took too long stays its own.
            pass
        assert store.list_temporary_files(path.parent) == claims
    assert store.list_temporary_files(path.parent) == []
    assert (time.monotonic() - began > 0.1) == is_there


def test_a_file_in_place_of_the_folder_is_told(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(store, "PRINTED_SUBJECTS", set())
    (tmp_path / "kernels").touch()
    monkeypatch.setenv(store.FOLDER_VARIABLE, str(tmp_path / "kernels"))
    assert store.kernel_folder.__wrapped__() is None
    assert "not kept on disk" in capfd.readouterr().err
