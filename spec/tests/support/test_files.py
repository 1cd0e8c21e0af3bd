"""Files are written whole or not at all."""

import errno
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from automcm_spec.support import files

PYTHON = [sys.executable, "-c"]
WRITE = "import sys; from pathlib import Path; from automcm_spec.support import files; "


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_text_and_bytes(tmp_path: Path) -> None:
    path = tmp_path / "report"
    files.write(path, "grün\n")
    assert path.read_bytes() == "grün\n".encode()
    files.write(path, b"\0", durable=True)
    assert path.read_bytes() == b"\0" and names(tmp_path) == ["report"]


@pytest.mark.parametrize("before", [None, "old"])
def test_what_fails_leaves_what_was_there(before: str | None, tmp_path: Path) -> None:
    path = tmp_path / "report"
    if before:
        path.write_text(before)
    with pytest.raises(KeyboardInterrupt), files.writing(path) as file:
        file.write(b"half")
        file.flush()
        raise KeyboardInterrupt
    assert names(tmp_path) == (["report"] if before else [])
    assert not before or path.read_text() == before


def test_a_full_disk_leaves_what_was_there(tmp_path: Path) -> None:
    """No file may be longer than some blocks: a disk that is full, for one process."""
    path = tmp_path / "report"
    path.write_text("old")
    code = WRITE + f"files.write(Path({str(path)!r}), b'x' * 10_000_000)"
    done = subprocess.run(
        ["sh", "-c", 'ulimit -f 100; exec "$@"', "sh", *PYTHON, code], capture_output=True
    )
    assert b"File too large" in done.stderr
    assert names(tmp_path) == ["report"] and path.read_text() == "old"


def test_a_reader_sees_the_old_or_the_new_and_writers_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "report"
    texts = [f"{n}" * 100_000 for n in range(4)]
    files.write(path, texts[0])

    def write(text: str) -> None:
        for _ in range(20):
            files.write(path, text)

    with ThreadPoolExecutor(len(texts)) as pool:
        writers = [pool.submit(write, text) for text in texts]
        while not all(writer.done() for writer in writers):
            assert path.read_text() in texts
        for writer in writers:
            writer.result()
    assert names(tmp_path) == ["report"]


def test_permissions_are_those_of_the_file_or_of_a_new_one(tmp_path: Path) -> None:
    usual, kept = tmp_path / "usual", tmp_path / "kept"
    usual.write_text("")
    kept.write_text("")
    kept.chmod(0o755)
    files.write(kept, "new")
    files.write(tmp_path / "new", "new")
    assert kept.stat().st_mode & 0o777 == 0o755
    assert (tmp_path / "new").stat().st_mode == usual.stat().st_mode


def test_a_link_stays_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    target, link, second = tmp_path / "there" / "target", tmp_path / "link", tmp_path / "second"
    link.symlink_to("there/target")
    second.symlink_to(link)
    for text in ("new", "newer"):  # the first is not there yet
        files.write(second, text, named=True)
        assert second.is_symlink() and link.is_symlink() and target.read_text() == text


@pytest.mark.parametrize(
    ("path", "link", "named"),
    [
        ("out/x", "out/x", False),
        ("runs/x/y", "runs", True),
        ("runs/x/y", "runs/x", True),
        ("runs/x/y", "runs/x/y", True),
    ],
)
def test_a_link_in_a_path_that_nobody_named_is_refused(
    path: str, link: str, named: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(link).parent.mkdir(parents=True, exist_ok=True)
    Path(link).symlink_to(tmp_path / "elsewhere")
    for change in (
        lambda: files.folder(Path(path), named=named),
        lambda: files.write(Path(path), ""),
    ):
        with pytest.raises(OSError, match="a symbolic link") as error:
            change()
        assert error.value.filename == link
    assert not (tmp_path / "elsewhere").exists()
    files.write(Path("/dev/stdout"), "no link of a folder")


def test_devices_and_pipes_are_written_directly(tmp_path: Path) -> None:
    files.write(Path("/dev/null"), "text")
    assert Path("/dev/null").is_char_device()
    with pytest.raises(OSError, match="No space left"):
        files.write(Path("/dev/full"), "text")
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        files.write(pipe, "text")
        assert reader.communicate()[0] == b"text"
    assert names(tmp_path) == ["pipe"]


@pytest.mark.parametrize("through_a_link", [False, True])
def test_standard_output_that_is_a_file_stays_that_file(
    through_a_link: bool, tmp_path: Path
) -> None:
    """A renamed file would replace it, and the shell's open file would be lost."""
    out, path = tmp_path / "out", "/dev/stdout"
    if through_a_link:
        path = str(tmp_path / "link")
        Path(path).symlink_to("/dev/stdout")
    with out.open("ab") as stdout:
        code = WRITE + f"files.write(Path({path!r}), 'first ', named=True); print('second')"
        subprocess.run([*PYTHON, code], stdout=stdout, check=True)
    assert "second" in out.read_text()


def test_what_is_no_place_for_a_file_is_named(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none" / "report", Path(__file__) / "report"):
        with pytest.raises(OSError) as error:
            files.write(path, "text")
        assert str(error.value.filename) == str(path)
    assert names(tmp_path) == []


def test_a_folder_that_takes_no_new_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise PermissionError(errno.EACCES, "Permission denied", "x")

    path = tmp_path / "report"
    monkeypatch.setattr(os, "open", refuse)  # root may write everywhere
    with pytest.raises(PermissionError) as error:
        files.write(path, "text")
    assert error.value.filename == str(path)
    path.write_text("old")
    files.write(path, "new")
    assert path.read_text() == "new"


def test_a_file_that_cannot_be_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one that a container has mounted."""

    def busy(*_: object) -> None:
        raise OSError(errno.EBUSY, "Device or resource busy")

    path = tmp_path / "report"
    path.write_text("old")
    monkeypatch.setattr(Path, "replace", busy)
    files.write(path, "new")
    assert path.read_text() == "new" and names(tmp_path) == ["report"]
