"""``automcm trace watch``: logs judged while they are written."""

from __future__ import annotations

import json
import select
import signal
import socket
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated

import typer

from automcm.links.link import LinkError
from automcm_cli.shared.common import Late, code_3, say_lines, usage
from automcm_cli.shared.station_options import Remote
from automcm_cli.trace.trace_logs import refuse_given
from automcm_spec.support.bad_input import SpooledInput

if TYPE_CHECKING:
    from automcm_spec.log_format.growing_file import GrowingFile
    from automcm_traces.explain.watch import Watch, WatchedLog, WatchReport

POLL_S = 0.02
"""How often the files are read."""
LARGEST = 65_535
BATCH = 1000
"""The maximum number of datagrams taken at once."""
MOST_SENDERS = 64
"""The maximum number of senders whose logs are not over; datagrams of others are ignored."""
STYLES = {"begun": "dim", "note": "yellow"}


def watch(
    logs: Annotated[
        list[str],
        typer.Argument(
            help="Logs of one run, which need not exist yet; - for standard input; udp:HOST:PORT "
            "for the logs that stations send there (station --log-to)."
        ),
    ],
    late: Late = None,
    allow_remote: Remote = False,
    json_: Annotated[
        Path | None,
        typer.Option(
            "--json",
            help="Write each report as one line of JSON to this file; - for standard output.",
        ),
    ] = None,
) -> None:
    """Check logs while they are written.

    Reports the first violation of each log as soon as the log shows it, in constant memory. Ends
    when each log has ended or diverged, or on Ctrl-C or SIGTERM. It then prints the verdict on each
    log so far, and judges several logs together, as explain does. The exit code is that of explain.
    """
    from automcm_spec.support import scratch
    from automcm_traces.explain.watch import Watch, WatchReport

    if json_ is not None and str(json_) != "-":
        refuse_given(json_, map(Path, logs))
    watched = Watch(late)
    with ExitStack() as stack, code_3("watch", OSError):
        put = stack.enter_context(_output(json_))
        copies = stack.enter_context(scratch.folder("watch"))
        sources = stack.enter_context(closing(_Sources(watched, copies)))
        for name in dict.fromkeys(logs):
            sources.open(name, allow_remote)
        stopped = stack.enter_context(_signals())
        while not stopped and not watched.over:
            sources.wait()
            put(sources.changes())
            put(watched.advance())
        put(watched.finish())
        put([WatchReport("end", "", {"exit": watched.exit_code})])
    raise typer.Exit(watched.exit_code)


class _Sources:
    """The files and addresses from which the logs come."""

    def __init__(self, watched: Watch, copies: Path) -> None:
        self._watch, self._copies, self._numbers = watched, copies, count()
        self._files: dict[GrowingFile, WatchedLog] = {}
        self._sockets: dict[socket.socket, str] = {}
        self._senders: dict[str, WatchedLog] = {}
        self._waiting: set[GrowingFile] = set()
        """The files reported as missing."""

    def open(self, name: str, allow_remote: bool) -> None:
        """Read a file, or listen at an address.  Exits with code 2 or 3 if that is not possible."""
        where = name.removeprefix("udp:")
        if where == name:
            self._open(Path(name))
            return
        from automcm.links.udp_link import address, bind

        with usage(LinkError):
            host, port = address(where)
        with code_3("watch", LinkError):
            self._sockets[bind(host, port, allow_remote=allow_remote)] = name

    def wait(self) -> None:
        """Wait for POLL_S, or until a datagram comes; take the datagrams."""
        for ready in select.select(list(self._sockets), [], [], POLL_S)[0]:
            with suppress(BlockingIOError):
                for _ in range(BATCH):
                    data, (host, port) = ready.recvfrom(LARGEST)
                    if data:
                        self._take(f"{self._sockets[ready]} from {host}:{port}", data)

    def changes(self) -> Iterator[WatchReport]:
        """What happened to the files.  A file that begins anew is a new log."""
        from automcm_traces.explain.watch import WatchReport, note

        for file, log in list(self._files.items()):
            file.open()
            what = file.change()
            if what == "missing" and file not in self._waiting:
                self._waiting.add(file)
                text = f"{log.file}: waiting for the file"
                yield WatchReport("waiting", text, {"file": log.file})
            elif what in ("truncated", "replaced"):
                yield note(log.file, f"the file was {what}; what follows is a log of its own")
                yield from self._watch.end(log)
                file.close()
                del self._files[file]
                self._open(file.path)
            elif file.ended:
                yield from self._watch.end(log)

    def close(self) -> None:
        """Close the files and sockets."""
        for lines in [*self._files, *(log.lines for log in self._senders.values())]:
            lines.close()
        for sock in self._sockets:
            sock.close()

    def _open(self, path: Path) -> None:
        from automcm_spec.log_format.growing_file import GrowingFile

        if path.is_dir():
            raise IsADirectoryError(f"{path} is a folder: name the logs in it")
        again = self._copy(str(path)) if str(path) == "-" or path.is_fifo() else None
        file = GrowingFile(path, again)
        self._files[file] = self._watch.add(again or path, file)

    def _copy(self, given: str) -> Path:
        """The file for a copy of what cannot be read again."""
        path = SpooledInput(self._copies, f"{next(self._numbers)}.ndjson")
        path.given = given
        return path

    def _take(self, sender: str, data: bytes) -> None:
        from automcm_spec.log_format.growing_file import LineBuffer

        if sender not in self._senders:
            over = (name for name, log in self._senders.items() if log.verdict is not None)
            full = len(self._senders) >= MOST_SENDERS
            if full and self._senders.pop(next(over, ""), None) is None:
                return
            again = self._copy(sender)
            self._senders[sender] = self._watch.add(again, LineBuffer(again))
        log = self._senders[sender]
        if log.verdict is None:
            log.lines.put(data if data.endswith(b"\n") else data + b"\n")


@contextmanager
def _output(json_: Path | None) -> Iterator[Callable[[Iterable[WatchReport]], None]]:
    """A function that writes reports at once: as text, as JSON, or both."""
    from rich.text import Text

    from automcm_cli.shared.terminal import Terminal

    console = Terminal(highlight=False)
    text = str(json_) != "-"
    with ExitStack() as stack:
        out: IO[str] | None = None if text else sys.stdout
        if json_ is not None and text:
            stack.callback(_without_empty, json_)
            out = stack.enter_context(json_.open("w", encoding="utf-8"))

        def put(reports: Iterable[WatchReport]) -> None:
            for one in reports:
                if out is not None:
                    out.write(json.dumps(one.as_dict()) + "\n")
                    out.flush()
                if not text or not one.text:
                    continue
                if console.is_terminal:
                    style = "" if console.no_color else STYLES.get(one.what, "")
                    console.print(Text(one.text, style), soft_wrap=True)
                elif one.what not in ("begun", "waiting"):
                    say_lines(one.text)
                    sys.stdout.flush()

        yield put


def _without_empty(path: Path) -> None:
    """Remove a file that took no byte, as on a full disk."""
    if path.stat().st_size == 0:
        path.unlink()


@contextmanager
def _signals() -> Iterator[list[int]]:
    """The signals SIGINT and SIGTERM that have come, instead of their usual effect."""
    came: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda n, _: came.append(n)) for number in numbers]
    try:
        yield came
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
