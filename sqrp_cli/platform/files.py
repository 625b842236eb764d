"""Writing files so that a reader never sees half of one."""

from __future__ import annotations

import os
import shlex
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem, bad_input


def real_path(path: Path) -> Path:
    """The path with links resolved; circular links, for which `Path` raises an error, stay as they are."""
    return Path(os.path.realpath(path))


def check_writable(path: Path) -> None:
    """Raises InputError if a file cannot be written: no folder for it, no permission, or a folder of that name."""
    with naming(path):
        if path.exists() and not path.is_dir() and not os.access(path, os.W_OK):
            mend = f"choose another name, or: chmod u+w {shlex.quote(str(path))}"
            raise bad_input("cannot-write", "this file is write-protected", Place(path), mend=mend)
        if _is_special(path):
            return
        folder = real_path(path).parent if path.is_symlink() else path.parent
        if not folder.is_dir():
            raise InputError(no_folder(folder, path))
        if path.is_dir():
            raise bad_input("cannot-write", "this is a folder; expected the name of a file", Place(path))
        if not os.access(folder, os.W_OK):
            raise bad_input("cannot-write", f"the folder {folder} cannot be written to", Place(path))


def no_folder(folder: Path, path: Path) -> Problem:
    """The problem that the folder for a new file or folder at `path` does not exist."""
    there = next(above for above in (folder, *folder.parents) if above.exists())
    if not there.is_dir():
        return Problem("cannot-write", f"{there} is a file, so nothing can be below it", Place(path))
    mend = f"mkdir -p {shlex.quote(str(folder))}"
    return Problem("cannot-write", f"there is no folder {folder}", Place(path), mend=mend)


def make_folder(path: Path) -> None:
    """Make a folder and its parents if they do not exist. Raises InputError if that fails."""
    with naming(path, "this folder cannot be made"):
        try:
            path.mkdir(parents=True, exist_ok=True)
        except FileExistsError as error:
            raise bad_input("cannot-write", "this is a file; expected the name of a folder", Place(path)) from error


def check_not_read(outputs: Iterable[Path | None], inputs: Iterable[Path | None]) -> None:
    """Raises InputError if an output file is also an input file; None means no file."""
    written = [path for path in outputs if path is not None]
    read = {real_path(path) for path in inputs if path is not None} if written else set()
    for path in written:
        if real_path(path) in read:
            message = "this file is read by the same command, so it is not overwritten"
            raise bad_input("would-overwrite", message, Place(path), mend="choose another name")


def check_distinct(outputs: Mapping[str, Path | None]) -> None:
    """Raises InputError if two options, by name, write the same file; None means no file."""
    options: dict[Path, str] = {}
    for option, path in outputs.items():
        if path is None or _is_special(path):
            continue
        other = options.setdefault(real_path(path), option)
        if other != option:
            message = f"{other} and {option} both name this file"
            raise bad_input("would-overwrite", message, Place(path), mend="choose another name for one of them")


def stamp_of(path: Path) -> tuple[int, ...]:
    """What changes when a file is saved; empty where there is none."""
    try:
        found = os.stat(path)  # noqa: PTH116 # `Path` takes longer, a thousand times per second
    except OSError:
        return ()
    return found.st_mtime_ns, found.st_size, found.st_ino


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Lock a file against other processes that call this, while this one reads and replaces it.

    Without effect where the operating system or the file system has no locks.
    """
    with ExitStack() as stack:
        with suppress(ImportError, OSError):
            import fcntl

            folder = os.open(real_path(path).parent, os.O_RDONLY)
            stack.callback(os.close, folder)
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield


def _is_special(path: Path) -> bool:
    """Whether a path is a device or pipe, or leads through one to its target, as /dev/stdout does."""
    through = path.absolute().as_posix().startswith(("/dev/std", "/dev/fd/", "/proc/"))
    return path.exists() and not path.is_dir() and (through or not path.is_file())


def write_atomically(path: Path, content: str | bytes, *, executable: bool = False) -> None:
    """Replace a file by text or bytes, all or nothing; executable: with the run bit for everyone who may read it.

    A link stays a link: its target is replaced. A device or pipe is written to, not replaced. Raises InputError if the
    file cannot be written.
    """
    check_writable(path)
    data = content.encode() if isinstance(content, str) else content
    with naming(path):
        if _is_special(path):
            with suppress(BrokenPipeError), path.open("ab") as special:  # after earlier output to it
                special.write(data)
        else:
            target = real_path(path)
            descriptor, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
            try:
                with os.fdopen(descriptor, "wb") as file:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())
                mask = os.umask(0)
                os.umask(mask)
                Path(name).chmod((0o777 if executable else 0o666) & ~mask)
                Path(name).replace(target)
            except BaseException:
                Path(name).unlink(missing_ok=True)
                raise


@contextmanager
def naming(path: Path, what: str = "this file cannot be written") -> Iterator[None]:
    """Turns an OSError while writing, as on a full disk, into an InputError that names the file or folder."""
    try:
        yield
    except OSError as error:
        why = error.args[0][-1][-1] if isinstance(error, shutil.Error) else error.strerror or error
        raise bad_input("cannot-write", f"{what}: {why}", Place(path)) from error
