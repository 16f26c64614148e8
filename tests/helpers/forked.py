"""Processes of metamerlab that begin with its modules read: forks of one that has read them.

To read them takes most of a second, and tests start hundreds of processes. Everything else is as
in a process of its own: arguments, environment, folder, output, signals, exit. What a process
reads, and when, is for tests that start Python itself.
"""

import atexit
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from functools import cache
from pathlib import Path

METAMERLAB = "from study_app.cli import main; main()"
# Each command is a fork of a fork: the one in the middle tells how it ended.
SERVER = """
import atexit, gc, importlib, json, os, signal, socket, sys, threading, traceback

def wait_for_command():
    while True:
        text, descriptors, _, _ = socket.recv_fds(asked, 1 << 20, 3)
        if not text:
            os._exit(0)  # the tests are over
        if os.fork() == 0:
            return json.loads(text), descriptors
        for descriptor in descriptors:
            os.close(descriptor)

def become(arguments, env, folder, out, err, tell):
    asked.close()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    child = os.fork()
    if child:
        os.write(tell, f"{child}\\n".encode())
        _, status, used = os.wait4(child, 0)
        cpu_s = used.ru_utime + used.ru_stime
        os.write(tell, f"{os.waitstatus_to_exitcode(status)} {cpu_s}\\n".encode())
        os._exit(0)
    os.close(tell)
    for number, descriptor in enumerate((os.open(os.devnull, os.O_RDONLY), out, err)):
        os.dup2(descriptor, number)
        os.close(descriptor)
    told = dict(encoding=sys.stdout.encoding, closefd=False)  # pipes now, where files may have been
    sys.stdout = sys.__stdout__ = open(1, "w", errors=sys.stdout.errors, **told)
    sys.stderr = sys.__stderr__ = open(2, "w", 1, errors="backslashreplace", **told)
    os.environ.clear()
    os.environ.update(env)
    os.chdir(folder)
    sys.argv = ["metamerlab", *arguments]

for name in sys.argv[2:]:
    importlib.import_module(name)
gc.freeze()  # what is there need not be looked at again, and so not copied
signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those in the middle
asked = socket.socket(fileno=int(sys.argv[1]))
wanted, descriptors = wait_for_command()
become(wanted["arguments"], wanted["env"], wanted["folder"], *descriptors)
status = 1
try:
    exec(compile(wanted["code"], "<string>", "exec"), {"__name__": "__main__"})
    status = 0
except SystemExit as end:
    status = end.code or 0
    if not isinstance(status, int):
        print(status, file=sys.stderr)
        status = 1
except BaseException:
    traceback.print_exc()
# As Python ends, but for taking its modules apart, which takes as long as to read them.
threading._shutdown()
atexit._run_exitfuncs()
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)
"""
READ = (
    "PIL.PngImagePlugin", "analysis.report.write_report", "analysis.tasks.preference", "jinja2",
    "moderngl", "stimuli.batch.build", "stimuli.batch.check", "study_app.cli",
    "study_app.presenter", "study_app.run", "study_app.session", "study_app.desktop.window",
)  # fmt: skip

COSTS_S: list[float] = []
"""CPU time of every process that has ended; the system counts them for nobody here."""


# The command `metamerlab` of a page's shell: a small process that asks for a fork, and waits.
SHIM = """#!{python} -IS
import json, os, socket, sys

asked = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
asked.connect({address!r})
wanted = dict(arguments=sys.argv[1:], code={code!r}, env=dict(os.environ), folder=os.getcwd())
socket.send_fds(asked, [json.dumps(wanted).encode()], [1, 2])
status = int(asked.recv(20))
sys.exit(status if status >= 0 else 128 - status)
"""


@cache
def _server() -> socket.socket:
    """Start the process that forks, which ends with this one; return where it is asked."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    number = str(theirs.fileno())
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", SERVER, number, *READ],
        pass_fds=(theirs.fileno(),),
        stdin=subprocess.DEVNULL,
    )
    theirs.close()

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours


def _text_of(written: int) -> str:
    with os.fdopen(written, "rb") as file:
        file.seek(0)
        return file.read().decode()


class Forked:
    """A process that runs Python text, as ``subprocess.Popen`` gives it where output is text.

    Parameters
    ----------
    arguments : str
        What stands in ``sys.argv`` after the program's name.
    code : str, optional
        The text; by default the command `metamerlab`.
    env, folder : optional
        Its environment and working directory; by default those of this process.
    """

    def __init__(
        self,
        *arguments: object,
        code: str = METAMERLAB,
        env: Mapping[str, str] = os.environ,
        folder: Path = Path(),
    ) -> None:
        self.args, self.returncode = arguments, None
        wanted = {
            "arguments": [*map(str, arguments)],
            "code": code,
            "env": dict(env),
            "folder": str(folder.resolve()),
        }
        self._written = [os.memfd_create(name) for name in ("out", "err")]
        self._texts: tuple[str, ...] = ()
        told, tell = os.pipe()
        socket.send_fds(_server(), [json.dumps(wanted).encode()], [*self._written, tell])
        os.close(tell)
        self._told = os.fdopen(told)
        self.pid = int(self._told.readline())

    def __del__(self) -> None:
        """Close what tells of a process that nobody waited for, as where a test fails."""
        if self.returncode is None and not self._told.closed:
            self._told.close()
            for written in self._written:
                os.close(written)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end; return its status, below 0 where a signal ended it."""
        if self.returncode is None:
            if not select.select([self._told], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(self.args, timeout)
            status, cpu_s = self._told.readline().split()
            self.returncode = int(status)
            COSTS_S.append(float(cpu_s))
            self._told.close()
            self._texts = tuple(map(_text_of, self._written))
        return self.returncode

    def poll(self) -> int | None:
        """Return its status if it has ended."""
        try:
            return self.wait(0)
        except subprocess.TimeoutExpired:
            return None

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait for its end; return all that it wrote."""
        self.wait(timeout)
        out, err = self._texts
        return out, err

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)


class Started(subprocess.Popen[str]):
    """A process as `Forked` gives it, started by itself: elsewhere than on Linux."""

    def __init__(
        self,
        *arguments: object,
        code: str = METAMERLAB,
        env: Mapping[str, str] = os.environ,
        folder: Path = Path(),
    ) -> None:
        super().__init__(
            [sys.executable, "-P", "-c", code, *map(str, arguments)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=dict(env), cwd=folder, encoding="utf-8",
        )  # fmt: skip


if sys.platform != "linux":
    Forked = Started  # type: ignore[misc]


def run(
    *arguments: object, timeout: float | None = None, **kwargs: object
) -> subprocess.CompletedProcess[str]:
    """Run a process to its end; see `Forked`."""
    process = Forked(*arguments, **kwargs)
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)


@cache
def programs() -> Path:
    """Return a folder for the front of a shell's PATH, where `metamerlab` is a fork."""
    folder = Path(tempfile.mkdtemp(prefix="metamerlab-forked-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    door.bind(str(folder / "door"))
    door.listen()
    shim = folder / "metamerlab"
    address = str(folder / "door")
    shim.write_text(SHIM.format(python=sys.executable, address=address, code=METAMERLAB))
    shim.chmod(0o755)
    threading.Thread(target=_let_in, args=(door,), daemon=True).start()
    return folder


def _let_in(door: socket.socket) -> None:
    while True:
        asker, _ = door.accept()
        threading.Thread(target=_pass_on, args=(asker,), daemon=True).start()


def _pass_on(asker: socket.socket) -> None:
    with asker:
        text, descriptors, _, _ = socket.recv_fds(asker, 1 << 20, 2)
        told, tell = os.pipe()
        socket.send_fds(_server(), [text], [*descriptors, tell])
        for descriptor in (*descriptors, tell):
            os.close(descriptor)
        with os.fdopen(told) as file:
            file.readline()
            status, cpu_s = file.readline().split()
        COSTS_S.append(float(cpu_s))
        asker.send(status.encode())
