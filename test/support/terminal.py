"""A shell in a terminal of its own, as a person has it."""

import os
import pty
import re
import select
import signal
import sys
import threading
from contextlib import suppress
from pathlib import Path

from waiting import PATIENCE, wait_for


class Terminal:
    """A shell in a terminal."""

    def __init__(self) -> None:
        self._pid, self._master = pty.fork()
        if self._pid == 0:
            signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup has it ignored
            os.environ |= {"PS1": "$ ", "TERM": "xterm"}
            paths = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
            os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
            os.execvp("bash", ["bash", "--norc", "--noprofile", "--noediting", "-i"])
        self.shown = ""
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with suppress(OSError):  # the shell has gone
            while not self._ended.is_set():
                if select.select([self._master], [], [], 0.1)[0]:
                    self.shown += os.read(self._master, 4096).decode(errors="replace")

    def type(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def waits_for(self, pattern: str) -> str:
        """What is shown up to and with a pattern, which is then done with."""
        found = wait_for(
            lambda: re.search(pattern, self.shown, re.DOTALL),
            why=lambda: f"{pattern!r} is not in {self.shown}",
        )
        text, self.shown = self.shown[: found.end()], self.shown[found.end() :]
        return text

    def start(self, program: str) -> None:
        self.type(f"{sys.executable} {program}\n")

    def is_as_before(self) -> bool:
        """Whether the shell finds the terminal as it should be."""
        self.type("stty -a; echo do''ne\n")
        text = self.waits_for(r"done\r")
        return " icanon" in text and " echo " in text

    def close(self) -> None:
        """Hang up, as when a window is closed, and wait until the programs have ended."""
        os.kill(self._pid, signal.SIGHUP)
        self._thread.join(PATIENCE)
        os.kill(self._pid, signal.SIGKILL)
        os.waitpid(self._pid, 0)
        self._ended.set()
        self._thread.join(PATIENCE)
        os.close(self._master)
